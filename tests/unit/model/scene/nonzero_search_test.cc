#include "model/scene/nonzero_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::scene::nonzero_search_test {
namespace {

constexpr int kHeight = 13;
constexpr int kChannels = 5;

// [H, W, C] of which one value in `one_in` is nonzero, at random.
std::vector<uint8_t> RandomBytes(int width, unsigned one_in) {
  std::mt19937 random(static_cast<unsigned>(width));
  std::vector<uint8_t> bytes(static_cast<size_t>(kHeight * width * kChannels));
  for (uint8_t& byte : bytes) {
    byte = random() % one_in == 0 ? static_cast<uint8_t>(1 + random() % 255) : 0;
  }
  return bytes;
}

// The raster of these bytes, with numbers in the padding of every third row, which has no meaning.
Raster Drawn(int width, const std::vector<uint8_t>& bytes) {
  Raster raster = RasterOf(kHeight, width, kChannels, bytes);
  const int end = static_cast<int>(raster.stride());
  for (int row = 0; row < kHeight; row += 3) {
    raster.MarkNonzero(1, row, raster.BlocksOf(width - 1, end - 1));
    std::fill(raster.Row(1, row) + width, raster.Row(1, row) + end, 0xff);
  }
  return raster;
}

// Narrower than eight pixels, with and without a remainder, and wide enough for larger blocks.
class NonzeroSearchTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Widths, NonzeroSearchTest, testing::Values(1, 7, 8, 22, 600));

TEST_P(NonzeroSearchTest, FindsEveryNonzeroValueInOrder) {
  const int width = GetParam();
  const auto bytes = RandomBytes(width, 9);
  const Raster raster = Drawn(width, bytes);
  NonzeroSearch search;
  kernels::NonzeroValues values;  // used again
  for (const int first : {0, 3}) {
    ASSERT_TRUE(search.Find(raster, first, static_cast<int64_t>(bytes.size()), &values));
    size_t value = 0, pixel = 0, byte = 0;
    for (size_t row = 0; row < kHeight; ++row) {
      ASSERT_EQ(values.rows[row], static_cast<int>(pixel));
      for (int column = 0; column < width; ++column) {
        const size_t begin = value;
        for (int channel = 0; channel < kChannels; ++channel, ++byte) {
          if (channel < first || bytes[byte] == 0) continue;
          ASSERT_EQ(values.values[value].place, column * kChannels + channel);
          ASSERT_EQ(values.values[value++].value, static_cast<float>(bytes[byte]));
        }
        if (value == begin) continue;
        ASSERT_EQ(values.pixels[pixel].column, column);
        ASSERT_EQ(values.pixels[pixel].begin, static_cast<int>(begin));
        ASSERT_EQ(values.pixels[pixel++].end, static_cast<int>(value));
      }
    }
    EXPECT_EQ(values.count, static_cast<int>(value));
    EXPECT_EQ(values.pixels.size(), pixel);
    EXPECT_EQ(values.rows.size(), size_t{kHeight} + 1);
    EXPECT_EQ(values.rows.back(), static_cast<int>(pixel));
    EXPECT_EQ(values.Trimmed().values.size(), value);
  }
}

TEST_P(NonzeroSearchTest, GivesUpIfTooManyAreNonzero) {
  const auto bytes = RandomBytes(GetParam(), 2);
  const Raster raster = Drawn(GetParam(), bytes);
  const auto nonzero = static_cast<int64_t>(bytes.size()) - std::ranges::count(bytes, 0);
  NonzeroSearch search;
  kernels::NonzeroValues values;
  EXPECT_TRUE(search.Find(raster, 0, nonzero, &values));
  EXPECT_FALSE(search.Find(raster, 0, nonzero - 1, &values));
}

}  // namespace
}  // namespace maneuver::scene::nonzero_search_test
