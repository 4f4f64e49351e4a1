// Poses in the plane, SE(2).
//
// Naming: X_WT is the pose of frame T measured in frame W; p_WP is the position of point P in W.
// A point moves between frames by p_WP = X_WT * p_TP.

#ifndef MANEUVER_MODEL_SCENE_POSE2_H_
#define MANEUVER_MODEL_SCENE_POSE2_H_

#include <cmath>

namespace maneuver::scene {

struct Point2 {
  double x = 0.0;  // metres
  double y = 0.0;  // metres
};

// A rotation by `heading` (counter-clockwise, radians) and a translation to (x, y), metres.
class Pose2 {
 public:
  Pose2() = default;
  Pose2(double x, double y, double heading)
      : x_(x), y_(y), heading_(heading), cos_(std::cos(heading)), sin_(std::sin(heading)) {}

  double x() const { return x_; }
  double y() const { return y_; }
  double heading() const { return heading_; }
  double cosine() const { return cos_; }
  double sine() const { return sin_; }

  // Returns p_WP for p_TP, where this pose is X_WT.
  Point2 operator*(const Point2& p) const {
    return {x_ + cos_ * p.x - sin_ * p.y, y_ + sin_ * p.x + cos_ * p.y};
  }

  // Returns p_TP for p_WP, where this pose is X_WT.
  Point2 ToLocal(const Point2& p) const {
    const double dx = p.x - x_;
    const double dy = p.y - y_;
    return {cos_ * dx + sin_ * dy, -sin_ * dx + cos_ * dy};
  }

 private:
  double x_ = 0.0;
  double y_ = 0.0;
  double heading_ = 0.0;
  double cos_ = 1.0;
  double sin_ = 0.0;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_POSE2_H_
