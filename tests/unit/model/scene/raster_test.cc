#include "model/scene/raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "model/scene/brush.h"

namespace maneuver::scene::raster_test {
namespace {

constexpr int kHeight = 30;
constexpr int kChannels = 3;

// Paints random shapes of every kind, some of them clipped.
void PaintAtRandom(Raster* raster, std::mt19937_64* random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(*random);
  };
  const auto place = [&] {
    return PixelPoint{uniform(-5, raster->width() + 5), uniform(-5, kHeight + 5)};
  };
  Brush brush;
  const double angle = uniform(-M_PI, M_PI);
  brush.DrawPolyline(raster, 0, PixelLine(std::vector{place(), place(), place()}), 255);
  brush.FillPolygon(raster, 1, std::vector{place(), place(), place()}, 90);
  Brush::FillDisc(raster, 1, place(), 2.5, 150);
  Brush::FillBox(raster, 2, place(), {std::cos(angle), std::sin(angle)}, uniform(1, 9), 3, 200);
}

// Widths smaller than a vector, with and without a remainder, and wide enough for larger blocks.
class RasterTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Widths, RasterTest, testing::Values(1, 7, 8, 22, 224, 505, 600, 2000));

TEST_P(RasterTest, UnpaintedAndClearedPixelsAreZero) {
  Raster raster(kHeight, GetParam(), kChannels);
  EXPECT_EQ(raster.values(), static_cast<size_t>(kHeight * GetParam() * kChannels));
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 20; ++trial) {
    PaintAtRandom(&raster, &random);
    std::vector<uint8_t> bytes(raster.values(), 77);
    raster.WriteInterleaved(bytes);
    size_t i = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int column = 0; column < GetParam(); ++column) {
        for (int channel = 0; channel < kChannels; ++channel, ++i) {
          const uint8_t pixel = raster.Row(channel, row)[column];
          ASSERT_EQ(bytes[i], pixel) << row << " " << column << " " << channel;
          const PixelBlocks nonzero = raster.NonzeroBlocks(channel, row);
          ASSERT_TRUE(pixel == 0 || (nonzero >> raster.BlockOf(column) & 1) != 0)
              << row << " " << column << " " << channel;
        }
      }
    }
    if (trial % 2 == 1) raster.Mirror();
    raster.Clear();
    for (int row = 0; row < kHeight; ++row) {
      for (int channel = 0; channel < kChannels; ++channel) {
        ASSERT_EQ(raster.NonzeroBlocks(channel, row), 0U);
        for (ptrdiff_t column = 0; column < raster.stride(); ++column) {
          ASSERT_EQ(raster.Row(channel, row)[column], 0) << row << " " << column << " " << channel;
        }
      }
    }
  }
}

TEST_P(RasterTest, MirrorsEachRowWithItsBlocks) {
  Raster raster(kHeight, GetParam(), kChannels);
  std::mt19937_64 random(4);
  PaintAtRandom(&raster, &random);
  Raster mirrored = raster;
  mirrored.Mirror();
  for (int row = 0; row < kHeight; ++row) {
    for (int channel = 0; channel < kChannels; ++channel) {
      const int from = kHeight - 1 - row;
      ASSERT_EQ(mirrored.NonzeroBlocks(channel, row), raster.NonzeroBlocks(channel, from));
      ASSERT_TRUE(std::equal(mirrored.Row(channel, row), mirrored.Row(channel, row) + GetParam(),
                             raster.Row(channel, from)));
    }
  }
}

TEST_P(RasterTest, BlocksAreMultiplesOfEightPixels) {
  const Raster raster(kHeight, GetParam(), kChannels);
  EXPECT_EQ(raster.block_pixels() % Raster::kLanes, 0);
  EXPECT_LT(raster.BlockOf(static_cast<int>(raster.stride()) - 1), 64);
  EXPECT_EQ(raster.BlockOf(raster.block_pixels() - 1), 0);
  EXPECT_EQ(raster.BlockOf(raster.block_pixels()), 1);
}

}  // namespace
}  // namespace maneuver::scene::raster_test
