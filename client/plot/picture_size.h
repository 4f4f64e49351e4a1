// Private to plot/: how panels share a picture.

#ifndef MANEUVER_CLIENT_PLOT_PICTURE_SIZE_H_
#define MANEUVER_CLIENT_PLOT_PICTURE_SIZE_H_

#include <algorithm>
#include <cmath>

#include "absl/status/status.h"
#include "client/plot/canvas.h"

namespace maneuver::plot {

struct GridShape {
  int columns = 1;
  int rows = 1;
};

// Returns a grid for this many panels, with about as many columns as rows.
inline GridShape ShapeOf(int panels) {
  const int columns = static_cast<int>(std::ceil(std::sqrt(panels)));
  return {columns, (panels + columns - 1) / columns};
}

// Returns the place of panel `index`; panels fill the grid row by row.
inline Box CellOf(const GridShape& grid, int index, const Box& whole) {
  const double width = whole.width / grid.columns;
  const double height = whole.height / grid.rows;
  return {whole.left + width * (index % grid.columns), whole.top + height * (index / grid.columns),
          width, height};
}

inline constexpr int kMostSide = 12'000;  // of a picture, pixels

struct PictureSize {
  int width = 0;
  int height = 0;
};

// Returns the size of a picture with panels of this size, or with smaller ones of the same shape if
// a side would exceed kMostSide.
inline PictureSize SizeFor(const GridShape& grid, double panel_width, double panel_height) {
  const double width = panel_width * grid.columns;
  const double height = panel_height * grid.rows;
  const double scale = std::min({1.0, kMostSide / width, kMostSide / height});
  return {static_cast<int>(scale * width), static_cast<int>(scale * height)};
}

// Returns INVALID_ARGUMENT unless both sides are 200 to 12000 pixels.
inline absl::Status CheckSize(int width, int height) {
  constexpr int kLeast = 200;
  if (std::min(width, height) >= kLeast && std::max(width, height) <= kMostSide) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError("a picture is 200 to 12000 pixels wide and high");
}

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_PICTURE_SIZE_H_
