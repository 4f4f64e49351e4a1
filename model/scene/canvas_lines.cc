#include <algorithm>
#include <cmath>

#include "model/scene/canvas.h"
#include "model/scene/chord.h"
#include "model/scene/clipping.h"
#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

// Lines reach this far from their middle, pixels.
constexpr double kLineReach = 1.0;

// On which sides of the picture a point lies, beyond what a line can be seen from: a bit for each.
// A line between two points on the same side is not seen.
uint8_t SidesBeyond(const PixelPoint& point, int height, int width) {
  return static_cast<uint8_t>((point.u < -kLineReach) | (point.u > width + kLineReach) << 1 |
                              (point.v < -kLineReach) << 2 | (point.v > height + kLineReach) << 3);
}

// Without a branch that nobody can foretell.
float WithinSegment(float t) { return std::min(std::max(t, 0.0F), 1.0F); }

}  // namespace

void Canvas::DrawPolyline(int channel, std::span<const PixelPoint> points, uint8_t intensity) {
  if (points.size() < 2) return;
  sides_.resize(points.size());
  for (size_t i = 0; i < points.size(); ++i) sides_[i] = SidesBeyond(points[i], height_, width_);
  // A stretch of the line is drawn from where it may be seen to where it no longer can.
  const auto is_unseen = [this](size_t end) { return (sides_[end - 1] & sides_[end]) != 0; };
  for (size_t end = 1; end < points.size();) {
    if (is_unseen(end)) {
      ++end;
      continue;
    }
    size_t start = end - 1;
    while (end < points.size() && !is_unseen(end)) ++end;
    while (start + 1 < end) {
      const size_t next = start + ChordEnd(points.subspan(start, end - start));
      DrawSegment(channel, points[start], points[next], intensity);
      start = next;
    }
  }
}

void Canvas::DrawSegment(int channel, PixelPoint a, PixelPoint b, float intensity) {
  // What is cut off lies too far outside to be seen, and floats suffice for the rest.
  constexpr double kMargin = 2 * kLineReach;
  double enter = 0.0;
  double leave = 1.0;
  ClipParameter(a.u, b.u, -kMargin, width_ + kMargin, &enter, &leave);
  ClipParameter(a.v, b.v, -kMargin, height_ + kMargin, &enter, &leave);
  if (!(enter <= leave)) return;
  const PixelPoint first = Between(a, b, enter);
  const PixelPoint last = Between(a, b, leave);

  constexpr auto kReach = static_cast<float>(kLineReach);
  const auto u = static_cast<float>(first.u);
  const auto v = static_cast<float>(first.v);
  const auto along_u = static_cast<float>(last.u - first.u);
  const auto along_v = static_cast<float>(last.v - first.v);
  const float length = std::sqrt(along_u * along_u + along_v * along_v);
  const float direction_u = length > 0.0F ? along_u / length : 1.0F;
  const float direction_v = length > 0.0F ? along_v / length : 0.0F;
  // How much of the segment a row is; a level one has next to no rows.
  constexpr float kLeastSlope = 1e-20F;
  const float per_row = 1.0F / (std::abs(along_v) > kLeastSlope ? along_v : kLeastSlope);
  const auto limit = static_cast<float>(width_);

  const auto [top, end_row] =
      PixelRange(std::min(first.v, last.v) - kReach, std::max(first.v, last.v) + kReach, height_);
  if (top >= end_row) return;
  uint8_t* pixels = RowsToPaint(channel, top, end_row);
  for (int row = top; row < end_row; ++row, pixels += stride_) {
    // The part of the segment that may lie within reach of this row's centres.
    const float centre = static_cast<float>(row) + 0.5F - v;
    const float ta = (centre - kReach) * per_row;
    const float tb = (centre + kReach) * per_row;
    const float u0 = u + WithinSegment(std::min(ta, tb)) * along_u;
    const float u1 = u + WithinSegment(std::max(ta, tb)) * along_u;
    const int left = std::max(0, static_cast<int>(std::min(u0, u1) - kReach));
    const float right = std::min(std::max(u0, u1) + kReach, limit);  // pixels that begin before it
    for (int column = left; static_cast<float>(column) < right; column += kLanes) {
      const FloatLanes du = kLaneIndex + (static_cast<float>(column) + 0.5F - u);
      const FloatLanes along =
          Most(FloatLanes{}, Least(du * direction_u + centre * direction_v, Broadcast(length)));
      const FloatLanes off_u = du - along * direction_u;
      const FloatLanes off_v = centre - along * direction_v;
      const FloatLanes distance = SquareRoot(off_u * off_u + off_v * off_v);
      PaintOver(Most(FloatLanes{}, kReach - distance) * intensity, pixels + column);
    }
  }
}

}  // namespace maneuver::scene
