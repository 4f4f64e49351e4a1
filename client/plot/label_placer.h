// Private to plot/: labels that cover neither each other nor what else must be seen.

#ifndef MANEUVER_CLIENT_PLOT_LABEL_PLACER_H_
#define MANEUVER_CLIENT_PLOT_LABEL_PLACER_H_

#include <optional>
#include <string>
#include <vector>

#include "client/plot/canvas.h"

namespace maneuver::plot {

class LabelPlacer {
 public:
  struct Placement {
    Box frame;         // around the text
    Pixel baseline;    // for Anchor::kCenter
    double gap = 0.0;  // between the point and the frame, pixels
  };

  // Labels stay within `whole`.
  explicit LabelPlacer(const Box& whole) : whole_(whole) {}

  // No label will be placed here.
  void Occupy(const Box& box);
  // The same along a line of this width.
  void Occupy(const Line& line, double width);

  // The free place for a label that is nearest to a point, at most `farthest` pixels from it, and
  // occupies it; nothing if there is none. To the right is tried first.
  //   height: of its capital letters, pixels; bold
  std::optional<Placement> Place(const Pixel& point, const std::string& text, double height,
                                 double farthest);

 private:
  bool Free(const Box& box) const;

  Box whole_;
  std::vector<Box> occupied_;
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_LABEL_PLACER_H_
