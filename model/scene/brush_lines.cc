#include <algorithm>

#include "model/kernels/points.h"
#include "model/kernels/raster_paint.h"
#include "model/scene/brush.h"
#include "model/scene/chord.h"
#include "model/scene/clipping.h"

namespace maneuver::scene {
namespace {

// Lines reach this far from their middle, pixels.
constexpr double kLineReach = 1.0;

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

  const kernels::SegmentShape segment = {.u = static_cast<float>(first.u),
                                         .v = static_cast<float>(first.v),
                                         .along_u = static_cast<float>(last.u - first.u),
                                         .along_v = static_cast<float>(last.v - first.v),
                                         .intensity = intensity};
  const auto [top, end_row] = PixelRange(std::min(first.v, last.v) - kLineReach,
                                         std::max(first.v, last.v) + kLineReach, picture_height);
  if (top >= end_row) return;
  // Of a slanted segment that is more than is painted, but found out once.
  constexpr auto kReach = static_cast<float>(kLineReach);
  const auto width = static_cast<float>(picture_width);
  const float end_u = segment.u + segment.along_u;
  const auto leftmost =
      static_cast<int>(std::clamp(std::min(segment.u, end_u) - kReach, 0.0F, width));
  const auto rightmost =
      static_cast<int>(std::clamp(std::max(segment.u, end_u) + kReach, 0.0F, width));
  const PixelBlocks blocks = raster->BlocksOf(leftmost, rightmost + kernels::kPaintLanes - 1);
  for (int row = top; row < end_row; ++row) raster->MarkNonzero(channel, row, blocks);
  kernels::PaintSegment(segment, picture_width,
                        {.first_row = top,
                         .last_row = end_row,
                         .pixels = raster->Row(channel, top),
                         .stride = raster->stride()});
}

}  // namespace

void Brush::DrawPolyline(Raster* raster, int channel, const PixelLine& points, uint8_t intensity) {
  if (points.size() < 2) return;
  sides_.resize(std::max(sides_.size(), points.size() + kernels::kPointLanes));
  // A line between two points beyond the same side is not seen.
  kernels::FindSides(points.u(), points.v(), points.size(), raster->height(), raster->width(),
                     kLineReach, sides_.data());
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
