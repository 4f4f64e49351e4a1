#include "model/scene/chord.h"

#include <algorithm>

#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

struct FourPoints {
  FourPoints(const PixelPoint& a, const PixelPoint& b, const PixelPoint& c, const PixelPoint& d)
      : u{a.u, b.u, c.u, d.u}, v{a.v, b.v, c.v, d.v} {}
  DoubleLanes u, v;
};

// Whether the chord from points[0] to points[end] passes all points between them: that they lie
// near it, and beside it rather than before or beyond it.
bool Passes(std::span<const PixelPoint> points, size_t end) {
  const PixelPoint& start = points[0];
  const double du = points[end].u - start.u;
  const double dv = points[end].v - start.v;
  const double squared = du * du + dv * dv;
  const double farthest = kChordTolerance * kChordTolerance;
  const bool is_point = squared <= farthest;  // has no beside
  const auto passes = [&](const FourPoints& four) {
    const DoubleLanes off_u = four.u - start.u;
    const DoubleLanes off_v = four.v - start.v;
    MaskLanes missed = off_u * off_u + off_v * off_v > farthest;
    if (!is_point) {
      const DoubleLanes across = off_u * dv - off_v * du;
      const DoubleLanes along = off_u * du + off_v * dv;
      missed = (across * across > farthest * squared) | (along < 0.0) | (along > squared);
    }
    return !AnyOf(missed);
  };
  // Every chord passes its own end, which makes up the last four.
  const auto point = [&](size_t i) -> const PixelPoint& { return points[std::min(i, end)]; };
  for (size_t i = 1; i < end; i += kPointLanes) {
    if (!passes({point(i), point(i + 1), point(i + 2), point(i + 3)})) return false;
  }
  return true;
}

}  // namespace

size_t ChordEnd(std::span<const PixelPoint> points) {
  // Twice as far for as long as it goes; then half as far from where it went, and so on.
  const size_t last = points.size() - 1;
  size_t end = 1;
  size_t step = 7;
  while (end < last && Passes(points, std::min(end + step, last))) {
    end = std::min(end + step, last);
    step = end;
  }
  for (step = std::min(step, last - end) / 2; step > 0; step /= 2) {
    if (Passes(points, end + step)) end += step;
  }
  return end;
}

}  // namespace maneuver::scene
