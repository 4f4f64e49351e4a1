// Private to plot/: a panel whose axes are metres at the same scale.

#ifndef MANEUVER_CLIENT_PLOT_AXES_H_
#define MANEUVER_CLIENT_PLOT_AXES_H_

#include <algorithm>
#include <vector>

#include "client/plot/canvas.h"

namespace maneuver::plot {

// Metres, x ahead (drawn to the right), y to the left (drawn upwards).
struct Extent {
  double min_x = 1e300;
  double max_x = -1e300;
  double min_y = 1e300;
  double max_y = -1e300;

  void Include(double x, double y) {
    min_x = std::min(min_x, x);
    max_x = std::max(max_x, x);
    min_y = std::min(min_y, y);
    max_y = std::max(max_y, y);
  }
};

struct AxesStyle {
  Color frame;
  Color text;
  Color grid;
  double text_height = 9.0;     // of the ticks' numbers, pixels
  double tick_distance = 70.0;  // pixels, about
  bool titles = true;           // "ahead [m]", "left [m]"
};

// Fits an extent into a box of the picture. Shows the whole extent, and more along the shorter
// side.
class Axes {
 public:
  Axes(const Box& box, const Extent& extent);

  Pixel ToPixel(double x, double y) const;
  double pixels_per_meter() const { return pixels_per_meter_; }
  const Box& box() const { return box_; }

  void DrawGrid(const AxesStyle& style, Canvas* canvas) const;
  void DrawFrame(const AxesStyle& style, Canvas* canvas) const;

 private:
  Box box_;
  double pixels_per_meter_;
  double left_;   // metres at the box's left edge
  double lower_;  // metres at its lower edge
};

// Returns about `count` round numbers (1, 2 or 5 times a power of ten) from `low` to `high`.
std::vector<double> Ticks(double low, double high, int count);
// Prints a tick with enough decimals to distinguish it from its neighbours.
std::string TickText(double tick, double step);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_AXES_H_
