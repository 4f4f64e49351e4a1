#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "model/scene/brush.h"
#include "model/scene/chord.h"
#include "model/scene/clipping.h"
#include "model/scene/lanes.h"

namespace maneuver::scene {
namespace {

// Lines reach this far from their middle, pixels.
constexpr double kLineReach = 1.0;

// On which sides of the picture points lie, beyond what a line can be seen from: a bit for each.
// A line between two points on the same side is not seen.
MaskLanes SidesBeyond(DoubleLanes u, DoubleLanes v, int height, int width) {
  return ((u < -kLineReach) & 1) | ((u > width + kLineReach) & 2) | ((v < -kLineReach) & 4) |
         ((v > height + kLineReach) & 8);
}

void DrawSegment(Raster* raster, int channel, PixelPoint a, PixelPoint b, float intensity) {
  const int picture_width = raster->width();
  const int picture_height = raster->height();
  // What is cut off lies too far outside to be seen, and floats suffice for the rest.
  constexpr double kMargin = 2 * kLineReach;
  double enter = 0.0;
  double leave = 1.0;
  const auto is_near = [&](const PixelPoint& p) {
    return p.u >= -kMargin && p.u <= picture_width + kMargin && p.v >= -kMargin &&
           p.v <= picture_height + kMargin;
  };
  if (!is_near(a) || !is_near(b)) {
    ClipParameter(a.u, b.u, -kMargin, picture_width + kMargin, &enter, &leave);
    ClipParameter(a.v, b.v, -kMargin, picture_height + kMargin, &enter, &leave);
    if (!(enter <= leave)) return;
  }
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
  const auto width = static_cast<float>(picture_width);

  const auto [top, end_row] = PixelRange(std::min(first.v, last.v) - kReach,
                                         std::max(first.v, last.v) + kReach, picture_height);
  if (top >= end_row) return;
  // Of a slanted segment that is more than is painted, but found out once.
  const auto leftmost =
      static_cast<int>(std::clamp(std::min(u, u + along_u) - kReach, 0.0F, width));
  const auto rightmost =
      static_cast<int>(std::clamp(std::max(u, u + along_u) + kReach, 0.0F, width));
  const PixelBlocks blocks = raster->BlocksOf(leftmost, rightmost + kLanes - 1);
  uint8_t* pixels = raster->Row(channel, top);
  const FloatLanes nothing = {};
  const FloatLanes end = Broadcast(length);
  // Eight rows at once for what is one number of a row, then row by row.
  for (int begin = top; begin < end_row; begin += kLanes) {
    const int rows = std::min(kLanes, end_row - begin);
    // The part of the segment that may lie within reach of the rows' centres.
    const FloatLanes centres = kLaneIndex + (static_cast<float>(begin) + 0.5F) - v;
    const FloatLanes ta = (centres - kReach) * per_row;
    const FloatLanes tb = (centres + kReach) * per_row;
    const FloatLanes u0 = u + Within(Least(ta, tb), 0.0F, 1.0F) * along_u;
    const FloatLanes u1 = u + Within(Most(ta, tb), 0.0F, 1.0F) * along_u;
    const auto left =
        __builtin_convertvector(Within(Least(u0, u1) - kReach, 0.0F, width), IntLanes);
    const FloatLanes right = Least(Most(u0, u1) + kReach, Broadcast(width));
    alignas(32) std::array<int32_t, kLanes> columns;
    alignas(32) std::array<float, kLanes> ends;
    alignas(32) std::array<float, kLanes> centre_of;
    std::memcpy(columns.data(), &left, sizeof(left));
    std::memcpy(ends.data(), &right, sizeof(right));
    std::memcpy(centre_of.data(), &centres, sizeof(centres));
    for (int i = 0; i < rows; ++i, pixels += raster->stride()) {
      const FloatLanes centre = Broadcast(centre_of[i]);
      const FloatLanes across = centre * direction_v;
      raster->Touch(channel, begin + i, blocks);
      int column = columns[i];
      do {  // mostly once
        const FloatLanes du = kLaneIndex + (static_cast<float>(column) + 0.5F - u);
        const FloatLanes along = Most(nothing, Least(du * direction_u + across, end));
        const FloatLanes off_u = du - along * direction_u;
        const FloatLanes off_v = centre - along * direction_v;
        const FloatLanes distance = SquareRoot(off_u * off_u + off_v * off_v);
        PaintOver(Most(nothing, kReach - distance) * intensity, pixels + column);
        column += kLanes;
      } while (static_cast<float>(column) < ends[i]);
    }
  }
}

}  // namespace

void Brush::DrawPolyline(Raster* raster, int channel, const PixelLine& points, uint8_t intensity) {
  if (points.size() < 2) return;
  sides_.resize(std::max(sides_.size(), points.size() + kPointLanes));
  for (size_t i = 0; i < points.size(); i += kPointLanes) {
    const MaskLanes sides =
        SidesBeyond(points.U(i), points.V(i), raster->height(), raster->width());
    std::memcpy(&sides_[i], &sides, sizeof(sides));
  }
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
      const size_t next = ChordEnd(points, start, end - 1);
      DrawSegment(raster, channel, points[start], points[next], intensity);
      start = next;
    }
  }
}

}  // namespace maneuver::scene
