// Curves in the plane, parameterised by arc length. Lengths are in metres, angles in radians
// (counter-clockwise), curvatures in 1/metres (positive to the left).

#ifndef MANEUVER_MODEL_DATA_TOWN_PATH_H_
#define MANEUVER_MODEL_DATA_TOWN_PATH_H_

#include <cmath>
#include <vector>

namespace maneuver::data::town {

struct Vec2 {
  double x = 0.0;  // metres
  double y = 0.0;  // metres
};

inline Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2 operator*(double k, Vec2 a) { return {k * a.x, k * a.y}; }
inline double Dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
inline double Cross(Vec2 a, Vec2 b) { return a.x * b.y - a.y * b.x; }
inline double Norm(Vec2 a) { return std::sqrt(Dot(a, a)); }
inline Vec2 Direction(double heading) { return {std::cos(heading), std::sin(heading)}; }
// Returns the direction 90 degrees to the left.
inline Vec2 Left(Vec2 a) { return {-a.y, a.x}; }
// Returns the equal angle in (-pi, pi].
double WrapAngle(double angle);

struct PathPoint {
  Vec2 p = {};
  double heading = 0.0;  // continuous along a path (not wrapped)
  double curvature = 0.0;
};

// A smooth curve, sampled about every half metre.
class Path {
 public:
  Path() = default;
  // Takes points in order along the curve: at least two, none repeated, at most a few metres apart.
  explicit Path(const std::vector<PathPoint>& points);

  double length() const { return length_; }
  // Returns the point `s` metres along; the path continues straight beyond its ends.
  PathPoint At(double s) const;
  // Returns the arc length nearest to p, found by local descent from `guess`. It may lie beyond the
  // ends.
  double Project(Vec2 p, double guess) const;
  // Returns the parallel curve `left` metres to the left. Bends to that side must have a larger
  // radius.
  Path Offset(double left) const;
  Path Reversed() const;
  Path Slice(double from, double to) const;
  const std::vector<PathPoint>& points() const { return points_; }
  double spacing() const { return spacing_; }

 private:
  std::vector<PathPoint> points_;  // equally spaced
  double length_ = 0.0;
  double spacing_ = 1.0;
};

// Draws a path from its curvature: straights, arcs and clothoids. Along a clothoid, curvature is
// linear in arc length (a steering wheel turned at a constant rate).
class PathPen {
 public:
  explicit PathPen(PathPoint start);

  PathPen& Straight(double length) { return Clothoid(length, 0.0, 0.0); }
  PathPen& Clothoid(double length, double curvature_from, double curvature_to);
  // Turns by `angle` (positive to the left): clothoid, arc of `radius`, clothoid. The two clothoids
  // together turn by half of the angle.
  PathPen& Turn(double angle, double radius);
  const PathPoint& end() const { return points_.back(); }
  Path Done() const { return Path(points_); }
  const std::vector<PathPoint>& points() const { return points_; }

 private:
  std::vector<PathPoint> points_;
};

// Returns a drivable curve from one pose to another. Where the tangents meet, it is a PathPen::Turn
// between straights; elsewhere a quintic curve with no curvature at its ends.
Path ConnectPoses(const PathPoint& from, const PathPoint& to);

// Returns a U-turn between antiparallel poses.
Path UTurnPath(const PathPoint& from, const PathPoint& to);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_PATH_H_
