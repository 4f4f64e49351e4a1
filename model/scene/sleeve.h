#ifndef MANEUVER_MODEL_SCENE_SLEEVE_H_
#define MANEUVER_MODEL_SCENE_SLEEVE_H_

#include <cmath>

#include "model/scene/canvas.h"

namespace maneuver::scene {

// The directions in which a chord from `origin` passes all points so far within kTolerance (the
// sleeve of Zhao and Saalfeld, 1997): a wedge that narrows with every point.
class Sleeve {
 public:
  static constexpr double kTolerance = 0.05;  // pixels

  explicit Sleeve(const PixelPoint& origin) : origin_(origin) {}

  // Whether a chord may end in `point`; if so, it counts among those to be passed.
  bool Extend(const PixelPoint& point) {
    const PixelPoint d{point.u - origin_.u, point.v - origin_.v};
    const double squared = d.u * d.u + d.v * d.v;
    if (reach_squared_ == 0.0) {
      if (squared <= kTolerance * kTolerance) return true;
    } else if (squared < reach_squared_ || Cross(right_, d) < 0.0 || Cross(d, left_) < 0.0) {
      return false;
    }
    const double tilt = kTolerance / std::sqrt(squared);
    const PixelPoint right{d.u + tilt * d.v, d.v - tilt * d.u};
    const PixelPoint left{d.u - tilt * d.v, d.v + tilt * d.u};
    if (reach_squared_ == 0.0 || Cross(right_, right) > 0.0) right_ = right;
    if (reach_squared_ == 0.0 || Cross(left, left_) > 0.0) left_ = left;
    reach_squared_ = squared;
    return true;
  }

 private:
  static double Cross(const PixelPoint& a, const PixelPoint& b) { return a.u * b.v - a.v * b.u; }

  PixelPoint origin_;
  PixelPoint right_, left_;     // sides of the wedge
  double reach_squared_ = 0.0;  // of the furthest point; 0 while there is no wedge
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SLEEVE_H_
