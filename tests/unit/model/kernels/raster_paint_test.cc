// Shapes against plain. Their coverage is held against distances and areas in
// model/scene/rasterizer_test.cc and beside it.

#include "model/kernels/raster_paint.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::raster_paint_test {
namespace {

constexpr int kHeight = 40;
constexpr int kWidth = 50;
constexpr int kStride = 64;

// A dim picture, so that both brighter and darker paint meets it.
std::vector<uint8_t> Picture() { return std::vector<uint8_t>(kHeight * kStride, 20); }

// Nobody sees what lies behind the last column.
void ClearBehind(std::vector<uint8_t>* picture) {
  for (int row = 0; row < kHeight; ++row) {
    std::fill_n(picture->begin() + row * kStride + kWidth, kStride - kWidth, uint8_t{0});
  }
}

class RasterPaintTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(RasterPaintTest);

TEST_P(RasterPaintTest, PaintsBoxesWithTheBytesOfPlain) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(0.0, 40.0);
  std::uniform_real_distribution<double> half(0.05, 9.0);
  for (int i = 0; i < 300; ++i) {
    const double heading = 0.1 * i;
    const BoxShape box = {.centre_u = place(random),
                          .centre_v = place(random),
                          .direction_u = std::cos(heading),
                          .direction_v = std::sin(heading),
                          .half_length = half(random),
                          .half_width = half(random),
                          .intensity = static_cast<float>(i % 256)};
    const int first = i % 17;
    const auto paint = [&] {
      auto picture = Picture();
      PaintBox(box, first, first + 32, {3, kHeight, &picture[3 * kStride], kStride});
      return picture;
    };
    ASSERT_EQ(paint(), Plain(paint)) << i;
  }
}

TEST_P(RasterPaintTest, PaintsSegmentsWithTheBytesOfPlain) {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> place(-2.0F, 52.0F);
  std::vector<PlacedSegment> segments;  // of one picture
  for (int i = 0; i < 1000; ++i) {
    SegmentShape segment = {.u = place(random),
                            .v = place(random),
                            .along_u = 0.0F,
                            .along_v = 0.0F,
                            .intensity = static_cast<float>(i % 256)};
    // Slanted, level, upright, and a point.
    if (i % 4 < 2) segment.along_u = place(random) - segment.u;
    if (i % 4 == 0 || i % 4 == 2) segment.along_v = place(random) - segment.v;
    const float low = std::min(segment.v, segment.v + segment.along_v);
    const float high = std::max(segment.v, segment.v + segment.along_v);
    const int first = std::clamp(static_cast<int>(low - 1.5F), 0, kHeight);
    const int last = std::clamp(static_cast<int>(high + 1.5F), 0, kHeight);
    segments.push_back({segment, {first, last, nullptr, kStride}});
    const auto paint = [&] {
      auto picture = Picture();
      for (PlacedSegment& each : segments) {
        each.rows.pixels = picture.data() + each.rows.first_row * kStride;
      }
      PaintSegments(segments, kWidth);
      ClearBehind(&picture);
      return picture;
    };
    ASSERT_EQ(paint(), Plain(paint)) << i;
    if (i % 2 == 0) segments.clear();  // one segment, then two
  }
}

}  // namespace
}  // namespace maneuver::kernels::raster_paint_test
