// Draws how often things happened, with intervals.

#ifndef MANEUVER_CLIENT_PLOT_SHARE_PLOT_H_
#define MANEUVER_CLIENT_PLOT_SHARE_PLOT_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::plot {

// A share and its interval, 0 to 1.
struct PlottedShare {
  double share = 0.0;
  double low = 0.0;
  double high = 0.0;
};

// The share of one row in one panel.
struct ShareCell {
  PlottedShare share;
  std::optional<PlottedShare> against;  // of what it is compared with
  bool changed = false;                 // the interval of the difference leaves out 0
};

struct SharePanel {
  std::string title;
  std::string subtitle;
  std::vector<ShareCell> cells;  // as SharePlot.rows
};

struct SharePlot {
  std::string title;
  std::string subtitle;
  std::string name;               // of what is drawn in the first colour
  std::string against;            // and in the second; empty: nothing is compared
  std::vector<std::string> rows;  // names
  std::vector<SharePanel> panels;
};

// Draws a row for each name and a column for each panel: a dot at the share, with its interval as a
// line. Cells that have changed have a coloured ground. All panels have one scale. Returns a PNG
// file; the same input gives the same file. INVALID_ARGUMENT if there is no row or no panel, if
// there are more than 60 rows or 12 panels, or if a panel does not have one cell for each row.
absl::StatusOr<std::string> DrawShares(const SharePlot& shares);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_SHARE_PLOT_H_
