// Private to plot/: how a panel of a scene is laid out, in pixels.

#ifndef MANEUVER_CLIENT_PLOT_PANEL_LAYOUT_H_
#define MANEUVER_CLIENT_PLOT_PANEL_LAYOUT_H_

#include "client/plot/canvas.h"

namespace maneuver::plot {

inline constexpr double kHeader = 46.0;      // over each panel
inline constexpr double kLeftMargin = 76.0;  // for the numbers of the axis
inline constexpr double kRightMargin = 18.0;
inline constexpr double kLowerMargin = 54.0;
inline constexpr double kRow = 20.0;      // of a legend
inline constexpr double kLetters = 10.0;  // height of its capitals

// Returns the place of the axes within a panel.
inline Box AxesBox(const Box& cell) {
  return {cell.left + kLeftMargin, cell.top + kHeader, cell.width - kLeftMargin - kRightMargin,
          cell.height - kHeader - kLowerMargin};
}

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_PANEL_LAYOUT_H_
