#include "model/data/town/path.h"

#include <algorithm>
#include <numbers>

namespace maneuver::data::town {
namespace {

constexpr double kSpacing = 0.5;       // metres between stored points
constexpr double kModelRadius = 40.0;  // metres, radius of the turn that others are scaled from

PathPoint Lerp(const PathPoint& a, const PathPoint& b, double t) {
  return {.p = a.p + t * (b.p - a.p),
          .heading = a.heading + t * (b.heading - a.heading),
          .curvature = a.curvature + t * (b.curvature - a.curvature)};
}

// Returns the quintic Bezier curve from a to b whose curvature vanishes at both ends.
Path QuinticPath(const PathPoint& a, const PathPoint& b) {
  const double reach = 0.25 * Norm(b.p - a.p);
  const Vec2 ta = Direction(a.heading);
  const Vec2 tb = Direction(b.heading);
  const Vec2 c[6] = {
      a.p, a.p + reach * ta, a.p + 2.0 * reach * ta, b.p - 2.0 * reach * tb, b.p - reach * tb, b.p};
  const int n = std::max(8, static_cast<int>(std::ceil(Norm(b.p - a.p) * 4.0)));
  std::vector<PathPoint> points;
  points.reserve(n + 1);
  double heading = a.heading;
  for (int i = 0; i <= n; ++i) {
    const double t = static_cast<double>(i) / n;
    Vec2 level[6];
    std::copy(std::begin(c), std::end(c), level);
    Vec2 first;
    Vec2 second;
    for (int degree = 5; degree > 0; --degree) {
      if (degree == 2) second = 20.0 * (level[2] - 2.0 * level[1] + level[0]);
      if (degree == 1) first = 5.0 * (level[1] - level[0]);
      for (int k = 0; k < degree; ++k) level[k] = level[k] + t * (level[k + 1] - level[k]);
    }
    const double speed = std::max(1e-9, Norm(first));
    heading += WrapAngle(std::atan2(first.y, first.x) - heading);
    points.push_back({.p = level[0],
                      .heading = heading,
                      .curvature = Cross(first, second) / (speed * speed * speed)});
  }
  return Path(points);
}

}  // namespace

double WrapAngle(double angle) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  angle = std::fmod(angle, kTurn);
  if (angle > std::numbers::pi) angle -= kTurn;
  if (angle <= -std::numbers::pi) angle += kTurn;
  return angle;
}

Path::Path(const std::vector<PathPoint>& points) {
  std::vector<double> s(points.size(), 0.0);
  for (size_t i = 1; i < points.size(); ++i) s[i] = s[i - 1] + Norm(points[i].p - points[i - 1].p);
  length_ = s.back();
  const int n = std::max(1, static_cast<int>(std::ceil(length_ / kSpacing)));
  spacing_ = length_ / n;
  points_.reserve(n + 1);
  size_t at = 0;
  for (int i = 0; i <= n; ++i) {
    const double here = i * spacing_;
    while (at + 2 < points.size() && s[at + 1] < here) ++at;
    const double span = std::max(1e-12, s[at + 1] - s[at]);
    points_.push_back(
        Lerp(points[at], points[at + 1], std::clamp((here - s[at]) / span, 0.0, 1.0)));
  }
}

PathPoint Path::At(double s) const {
  if (s <= 0.0 || s >= length_) {
    PathPoint end = s <= 0.0 ? points_.front() : points_.back();
    end.p = end.p + (s <= 0.0 ? s : s - length_) * Direction(end.heading);
    return end;
  }
  const double index = s / spacing_;
  const size_t i = std::min(static_cast<size_t>(index), points_.size() - 2);
  return Lerp(points_[i], points_[i + 1], index - static_cast<double>(i));
}

double Path::Project(Vec2 p, double guess) const {
  double s = guess;
  for (int i = 0; i < 8; ++i) {
    const PathPoint at = At(s);
    const Vec2 t = Direction(at.heading);
    const double step =
        Dot(p - at.p, t) / std::max(0.2, 1.0 - at.curvature * Dot(p - at.p, Left(t)));
    s += step;
    if (std::abs(step) < 1e-4) break;
  }
  return s;
}

Path Path::Offset(double left) const {
  std::vector<PathPoint> moved = points_;
  for (PathPoint& point : moved) {
    point.p = point.p + left * Left(Direction(point.heading));
    point.curvature /= 1.0 - point.curvature * left;
  }
  return Path(moved);
}

Path Path::Reversed() const {
  std::vector<PathPoint> turned(points_.rbegin(), points_.rend());
  for (PathPoint& point : turned) {
    point.heading += std::numbers::pi;
    point.curvature = -point.curvature;
  }
  return Path(turned);
}

Path Path::Slice(double from, double to) const {
  std::vector<PathPoint> kept = {At(from)};
  for (size_t i = 0; i < points_.size(); ++i) {
    const double s = static_cast<double>(i) * spacing_;
    if (s > from + 1e-6 && s < to - 1e-6) kept.push_back(points_[i]);
  }
  kept.push_back(At(to));
  return Path(kept);
}

PathPen::PathPen(PathPoint start) : points_{start} { points_[0].curvature = 0.0; }

PathPen& PathPen::Clothoid(double length, double curvature_from, double curvature_to) {
  if (length < 1e-6) return *this;
  const int n = std::max(1, static_cast<int>(std::ceil(length / 0.25)));
  const double ds = length / n;
  for (int i = 0; i < n; ++i) {
    const double from = curvature_from + (curvature_to - curvature_from) * i / n;
    const double to = curvature_from + (curvature_to - curvature_from) * (i + 1) / n;
    PathPoint next = points_.back();
    const double turned = 0.5 * (from + to) * ds;
    next.p = next.p + ds * Direction(next.heading + 0.5 * turned);
    next.heading += turned;
    next.curvature = to;
    points_.push_back(next);
  }
  return *this;
}

PathPen& PathPen::Turn(double angle, double radius) {
  const double curvature = (angle > 0.0 ? 1.0 : -1.0) / radius;
  const double arc = 0.5 * std::abs(angle) * radius;
  // A clothoid turns by half the angle of an arc of the same length.
  const double ramp = 0.5 * std::abs(angle) * radius;
  return Clothoid(ramp, 0.0, curvature)
      .Clothoid(arc, curvature, curvature)
      .Clothoid(ramp, curvature, 0.0);
}

Path ConnectPoses(const PathPoint& from, const PathPoint& to) {
  const double angle = WrapAngle(to.heading - from.heading);
  const Vec2 ta = Direction(from.heading);
  const Vec2 tb = Direction(to.heading);
  const double sine = Cross(ta, tb);
  if (std::abs(angle) < 0.1 || std::abs(sine) < 0.2) return QuinticPath(from, to);
  // The tangents meet in a corner, `before` metres ahead of `from` and `after` metres behind `to`.
  const Vec2 d = to.p - from.p;
  const double before = Cross(d, tb) / sine;
  const double after = Cross(ta, d) / sine;
  if (before < 1.0 || after < 1.0) return QuinticPath(from, to);
  const Vec2 unit_end = PathPen(PathPoint{}).Turn(angle, kModelRadius).end().p;
  const double unit_tangent = unit_end.y / std::sin(angle) / kModelRadius;
  const double tangent = std::min(before, after);
  PathPen pen(from);
  pen.Straight(before - tangent).Turn(angle, tangent / unit_tangent).Straight(after - tangent);
  std::vector<PathPoint> points = pen.points();
  // Spreads the error of the integration (millimetres) along the curve.
  const Vec2 error = to.p - points.back().p;
  for (size_t i = 0; i < points.size(); ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(points.size() - 1);
    points[i].p = points[i].p + share * error;
  }
  return Path(points);
}

Path UTurnPath(const PathPoint& from, const PathPoint& to) {
  const Vec2 t = Direction(from.heading);
  const double ahead = Dot(to.p - from.p, t);
  const double aside = Dot(to.p - from.p, Left(t));
  const double angle = aside > 0.0 ? std::numbers::pi : -std::numbers::pi;
  const double unit_aside =
      std::abs(PathPen(PathPoint{}).Turn(angle, kModelRadius).end().p.y) / kModelRadius;
  PathPen pen(from);
  pen.Straight(std::max(0.0, ahead)).Turn(angle, std::abs(aside) / unit_aside);
  pen.Straight(std::max(0.0, -ahead));
  return pen.Done();
}

}  // namespace maneuver::data::town
