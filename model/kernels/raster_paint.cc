#include "model/kernels/raster_paint.h"

#include <algorithm>
#include <cmath>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/raster_paint.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr float kReach = 1.0F;  // of a line from its middle, pixels

// A box's figures that are the same for all of its pixels.
struct BoxFigures {
  explicit BoxFigures(const BoxShape& box)
      : cosine(static_cast<float>(box.direction_u)),
        sine(static_cast<float>(box.direction_v)),
        end_x(static_cast<float>(box.half_length + 0.5)),
        end_y(static_cast<float>(box.half_width + 0.5)),
        most_x(std::min(1.0F, static_cast<float>(2.0 * box.half_length))),
        most_y(std::min(1.0F, static_cast<float>(2.0 * box.half_width))) {}

  float cosine, sine;
  // Along each axis of the box: where its overlap with a unit interval ends, and how much it can
  // be.
  float end_x, end_y;
  float most_x, most_y;
};

// A segment's figures.
struct SegmentFigures {
  explicit SegmentFigures(const SegmentShape& segment)
      : length(std::sqrt(segment.along_u * segment.along_u + segment.along_v * segment.along_v)),
        direction_u(length > 0.0F ? segment.along_u / length : 1.0F),
        direction_v(length > 0.0F ? segment.along_v / length : 0.0F),
        per_row(1.0F / (std::abs(segment.along_v) > kLeastSlope ? segment.along_v : kLeastSlope)) {}

  static constexpr float kLeastSlope = 1e-20F;
  float length;
  float direction_u, direction_v;
  float per_row;  // how much of the segment a row is; a level one has next to no rows
};

using Floats = hn::CappedTag<float, kPaintLanes>;
using Vector = hn::Vec<Floats>;
constexpr int kLanes = hn::MaxLanes(Floats());

using Words = hn::RebindToUnsigned<Floats>;
constexpr uint32_t kWholeBits = (uint32_t{1} << 23) - 1;

// Returns numbers whose kWholeBits are the whole part of value, 0 <= value < 2^23. ConvertTo takes
// six instructions instead of two: it also converts what is too large.
HWY_INLINE hn::Vec<Words> WholePart(Vector value) {
  // The lowest bit of a float of this size counts 1.
  return hn::BitCast(Words(), hn::Add(hn::Trunc(value), hn::Set(Floats(), 0x1p23F)));
}

// value: 0 .. 255.
HWY_INLINE void PaintOver(Vector value, uint8_t* pixels) {
  const hn::CappedTag<uint8_t, kLanes> bytes;
  // Takes the lowest byte of each word.
  const auto painted = hn::U8FromU32(WholePart(hn::Add(value, hn::Set(Floats(), 0.5F))));
  hn::StoreU(hn::Max(painted, hn::LoadU(bytes, pixels)), bytes, pixels);
}

// max(low, min(a, high))
HWY_INLINE Vector Within(Vector a, float low, float high) {
  return hn::Max(hn::Set(Floats(), low), hn::Min(a, hn::Set(Floats(), high)));
}

void FastBox(const BoxShape& box, int first_column, int last_column, const PaintRows& rows) {
  const Floats d;
  const BoxFigures figures(box);
  const Vector cosine = hn::Set(d, figures.cosine);
  const Vector sine = hn::Set(d, figures.sine);
  const Vector zero = hn::Zero(d);
  const Vector lane = hn::Iota(d, 0.0F);
  uint8_t* pixels = rows.pixels;
  for (int row = rows.first_row; row < rows.last_row; ++row, pixels += rows.stride) {
    const Vector dv = hn::Set(d, static_cast<float>(row + 0.5 - box.centre_v));
    for (int column = first_column; column < last_column; column += kLanes) {
      const Vector du = hn::Add(lane, hn::Set(d, static_cast<float>(column + 0.5 - box.centre_u)));
      const Vector x = hn::Abs(hn::Add(hn::Mul(cosine, du), hn::Mul(sine, dv)));
      const Vector y = hn::Abs(hn::Sub(hn::Mul(cosine, dv), hn::Mul(sine, du)));
      const Vector overlap_x =
          hn::Max(zero, hn::Min(hn::Set(d, figures.most_x), hn::Sub(hn::Set(d, figures.end_x), x)));
      const Vector overlap_y =
          hn::Max(zero, hn::Min(hn::Set(d, figures.most_y), hn::Sub(hn::Set(d, figures.end_y), y)));
      PaintOver(hn::Mul(hn::Mul(overlap_x, overlap_y), hn::Set(d, box.intensity)), pixels + column);
    }
  }
}

HWY_INLINE void FastSegment(const SegmentShape& segment, int width, const PaintRows& rows) {
  const Floats d;
  const SegmentFigures figures(segment);
  const auto right_end = static_cast<float>(width);
  const Vector reach = hn::Set(d, kReach);
  const Vector zero = hn::Zero(d);
  const Vector direction_u = hn::Set(d, figures.direction_u);
  const Vector direction_v = hn::Set(d, figures.direction_v);
  const Vector end = hn::Set(d, figures.length);
  const Vector begin_u = hn::Set(d, segment.u);
  const Vector along_u = hn::Set(d, segment.along_u);
  const Vector per_row = hn::Set(d, figures.per_row);
  const Vector intensity = hn::Set(d, segment.intensity);
  const Vector lane = hn::Iota(d, 0.0F);
  uint8_t* pixels = rows.pixels;
  // Eight rows at once for what is one number of a row, then row by row.
  for (int begin = rows.first_row; begin < rows.last_row; begin += kLanes) {
    const int count = std::min(kLanes, rows.last_row - begin);
    // The part of the segment that may lie within reach of the rows' centres.
    const Vector centres =
        hn::Sub(hn::Add(lane, hn::Set(d, static_cast<float>(begin) + 0.5F)), hn::Set(d, segment.v));
    const Vector ta = hn::Mul(hn::Sub(centres, reach), per_row);
    const Vector tb = hn::Mul(hn::Add(centres, reach), per_row);
    const Vector u0 = hn::Add(begin_u, hn::Mul(Within(hn::Min(ta, tb), 0.0F, 1.0F), along_u));
    const Vector u1 = hn::Add(begin_u, hn::Mul(Within(hn::Max(ta, tb), 0.0F, 1.0F), along_u));
    const Vector left = Within(hn::Sub(hn::Min(u0, u1), reach), 0.0F, right_end);
    const Vector right = hn::Min(hn::Add(hn::Max(u0, u1), reach), hn::Set(d, right_end));
    HWY_ALIGN uint32_t columns[kLanes];
    HWY_ALIGN float ends[kLanes];
    HWY_ALIGN float centre_of[kLanes];
    hn::Store(hn::And(WholePart(left), hn::Set(Words(), kWholeBits)), Words(), columns);
    hn::Store(right, d, ends);
    hn::Store(centres, d, centre_of);
    for (int i = 0; i < count; ++i, pixels += rows.stride) {
      const Vector centre = hn::Set(d, centre_of[i]);
      const Vector across = hn::Mul(centre, direction_v);
      auto column = static_cast<int>(columns[i]);
      do {  // mostly once
        const Vector du = hn::Add(lane, hn::Set(d, static_cast<float>(column) + 0.5F - segment.u));
        const Vector along = hn::Max(zero, hn::Min(hn::Add(hn::Mul(du, direction_u), across), end));
        const Vector off_u = hn::Sub(du, hn::Mul(along, direction_u));
        const Vector off_v = hn::Sub(centre, hn::Mul(along, direction_v));
        const Vector distance = hn::Sqrt(hn::Add(hn::Mul(off_u, off_u), hn::Mul(off_v, off_v)));
        PaintOver(hn::Mul(hn::Max(zero, hn::Sub(reach, distance)), intensity), pixels + column);
        column += kLanes;
      } while (static_cast<float>(column) < ends[i]);
    }
  }
}

void FastSegments(const PlacedSegment* segments, size_t count, int width) {
  for (size_t i = 0; i < count; ++i) FastSegment(segments[i].shape, width, segments[i].rows);
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

using HWY_NAMESPACE::BoxFigures;
using HWY_NAMESPACE::kReach;
using HWY_NAMESPACE::SegmentFigures;

void PaintPixel(float value, uint8_t* pixel) {
  *pixel = std::max(*pixel, static_cast<uint8_t>(value + 0.5F));
}

void PlainBox(const BoxShape& box, int first_column, int last_column, const PaintRows& rows) {
  const BoxFigures figures(box);
  uint8_t* pixels = rows.pixels;
  for (int row = rows.first_row; row < rows.last_row; ++row, pixels += rows.stride) {
    const auto dv = static_cast<float>(row + 0.5 - box.centre_v);
    for (int column = first_column; column < last_column; ++column) {
      // Rounded as where eight pixels are taken together.
      const int lane = (column - first_column) % kPaintLanes;
      const float du =
          static_cast<float>(lane) + static_cast<float>(column - lane + 0.5 - box.centre_u);
      const float x = std::abs(figures.cosine * du + figures.sine * dv);
      const float y = std::abs(figures.cosine * dv - figures.sine * du);
      const float overlap_x = std::max(0.0F, std::min(figures.most_x, figures.end_x - x));
      const float overlap_y = std::max(0.0F, std::min(figures.most_y, figures.end_y - y));
      PaintPixel(overlap_x * overlap_y * box.intensity, &pixels[column]);
    }
  }
}

void PlainSegment(const SegmentShape& segment, int width, const PaintRows& rows) {
  const SegmentFigures figures(segment);
  const auto right_end = static_cast<float>(width);
  uint8_t* pixels = rows.pixels;
  for (int row = rows.first_row; row < rows.last_row; ++row, pixels += rows.stride) {
    // Rounded as where eight rows and eight pixels are taken together.
    const int row_lane = (row - rows.first_row) % kPaintLanes;
    const float centre =
        static_cast<float>(row_lane) + (static_cast<float>(row - row_lane) + 0.5F) - segment.v;
    // The part of the segment that may lie within reach of the row's centre.
    const float ta = (centre - kReach) * figures.per_row;
    const float tb = (centre + kReach) * figures.per_row;
    const float u0 = segment.u + std::clamp(std::min(ta, tb), 0.0F, 1.0F) * segment.along_u;
    const float u1 = segment.u + std::clamp(std::max(ta, tb), 0.0F, 1.0F) * segment.along_u;
    const auto left = static_cast<int>(std::clamp(std::min(u0, u1) - kReach, 0.0F, right_end));
    const float right = std::min(std::max(u0, u1) + kReach, right_end);
    for (int column = left; column == left || static_cast<float>(column) < right; ++column) {
      const int lane = (column - left) % kPaintLanes;
      const float du =
          static_cast<float>(lane) + (static_cast<float>(column - lane) + 0.5F - segment.u);
      const float along = std::max(
          0.0F, std::min(du * figures.direction_u + centre * figures.direction_v, figures.length));
      const float off_u = du - along * figures.direction_u;
      const float off_v = centre - along * figures.direction_v;
      const float distance = std::sqrt(off_u * off_u + off_v * off_v);
      PaintPixel(std::max(0.0F, kReach - distance) * segment.intensity, &pixels[column]);
    }
  }
}

void PlainSegments(const PlacedSegment* segments, size_t count, int width) {
  for (size_t i = 0; i < count; ++i) PlainSegment(segments[i].shape, width, segments[i].rows);
}

HWY_EXPORT(FastBox);
HWY_EXPORT(FastSegments);

}  // namespace

void PaintBox(const BoxShape& box, int first_column, int last_column, const PaintRows& rows) {
  const auto paint = UsesPlainKernels() ? PlainBox : HWY_DYNAMIC_DISPATCH(FastBox);
  paint(box, first_column, last_column, rows);
}

void PaintSegments(std::span<const PlacedSegment> segments, int width) {
  const auto paint = UsesPlainKernels() ? PlainSegments : HWY_DYNAMIC_DISPATCH(FastSegments);
  paint(segments.data(), segments.size(), width);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
