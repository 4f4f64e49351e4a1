// Private to plot/: places labels so that they cover neither each other nor anything that must stay
// visible.

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

  // Keeps labels out of a box.
  void Occupy(const Box& box);
  // Keeps labels out of a line of this width.
  void Occupy(const Line& line, double width);

  // Finds the free place for a label that is nearest to a point, at most `farthest` pixels from it,
  // and occupies it. Returns nothing if there is none. Tries the right side first.
  //   height: height of the bold capital letters, pixels.
  std::optional<Placement> Place(const Pixel& point, const std::string& text, double height,
                                 double farthest);

 private:
  bool Free(const Box& box) const;

  Box whole_;
  std::vector<Box> occupied_;
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_LABEL_PLACER_H_
