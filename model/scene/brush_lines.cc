#include <algorithm>
#include <vector>

#include "model/kernels/points.h"
#include "model/kernels/raster_paint.h"
#include "model/scene/brush.h"
#include "model/scene/clipping.h"

namespace maneuver::scene {
namespace {

// Lines reach this far from their middle, pixels.
constexpr double kLineReach = 1.0;
// How far points may lie from the chord that leaves them out, pixels.
constexpr double kChordTolerance = 0.03;

// Appends the segment from a to b, if it may be seen, and marks the blocks that it paints.
void PlaceSegment(Raster* raster, int channel, PixelPoint a, PixelPoint b, float intensity,
                  std::vector<kernels::PlacedSegment>* segments) {
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
  segments->push_back({segment,
                       {.first_row = top,
                        .last_row = end_row,
                        .pixels = raster->Row(channel, top),
                        .stride = raster->stride()}});
}

}  // namespace

void Brush::DrawPolyline(Raster* raster, int channel, const PixelLine& points, uint8_t intensity) {
  if (points.size() < 2) return;
  const size_t room = points.size() + kernels::kPointLanes;
  if (sides_.size() < room) {
    sides_.resize(room);
    chords_.resize(room);
  }
  const size_t chords = kernels::FindChords(
      points.u(), points.v(), points.size(),
      {.height = raster->height(), .width = raster->width(), .reach = kLineReach}, kChordTolerance,
      sides_.data(), chords_.data());
  segments_.clear();
  for (size_t i = 0; i < chords; ++i) {
    PlaceSegment(raster, channel, points[chords_[i].first], points[chords_[i].last], intensity,
                 &segments_);
  }
  kernels::PaintSegments(segments_, raster->width());
}

}  // namespace maneuver::scene
