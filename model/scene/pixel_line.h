// The points of a line in the picture. Stores u and v separately, so that several points can be
// read as one vector.

#ifndef MANEUVER_MODEL_SCENE_PIXEL_LINE_H_
#define MANEUVER_MODEL_SCENE_PIXEL_LINE_H_

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "model/kernels/points.h"

namespace maneuver::scene {

// A point of the picture, in pixels: u along a row, v along a column. Pixel (row r, column c)
// covers [c, c+1) x [r, r+1).
struct PixelPoint {
  double u = 0.0;
  double v = 0.0;
};

class PixelLine {
 public:
  PixelLine() = default;
  explicit PixelLine(std::span<const PixelPoint> points) {
    Extend(points.size());
    for (size_t i = 0; i < points.size(); ++i) Set(i, points[i]);
  }

  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  PixelPoint operator[](size_t i) const { return {u_[i], v_[i]}; }
  // Return the coordinates of all points. After the last one, kernels::kPointLanes numbers are
  // allocated.
  const double* u() const { return u_.data(); }
  const double* v() const { return v_.data(); }
  double* u() { return u_.data(); }
  double* v() { return v_.data(); }

  // Removes all points and keeps the memory.
  void Clear() { size_ = 0; }
  // Appends `count` points, which the caller must set. Returns the index of the first.
  size_t Extend(size_t count) {
    const size_t first = size_;
    size_ += count;
    if (size_ + kernels::kPointLanes > u_.size()) {
      u_.resize(std::max(2 * u_.size(), size_ + kernels::kPointLanes));
      v_.resize(u_.size());
    }
    return first;
  }
  void Set(size_t i, const PixelPoint& point) {
    u_[i] = point.u;
    v_[i] = point.v;
  }

 private:
  size_t size_ = 0;
  std::vector<double> u_, v_;  // at least kPointLanes numbers beyond the last point
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_PIXEL_LINE_H_
