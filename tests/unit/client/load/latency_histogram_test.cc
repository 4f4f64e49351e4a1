#include "client/load/latency_histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace maneuver::load::latency_histogram_test {
namespace {

using std::chrono::nanoseconds;

TEST(LatencyHistogramTest, QuantilesMatchSortedValuesToAThousandth) {
  // From nanoseconds to half an hour, equally many in each power of two.
  std::mt19937_64 random(3);
  std::vector<int64_t> values;
  LatencyHistogram histogram;
  for (int i = 0; i < 20'000; ++i) {
    const double exponent = 41.0 * static_cast<double>(random() >> 11) * 0x1p-53;
    values.push_back(static_cast<int64_t>(std::exp2(exponent)));
    histogram.Record(nanoseconds(values.back()));
  }
  std::sort(values.begin(), values.end());
  for (const double quantile : {0.0001, 0.1, 0.5, 0.9, 0.99, 0.999, 0.9999, 1.0}) {
    const auto rank = static_cast<size_t>(std::ceil(quantile * 20'000 - 1e-6)) - 1;
    const int64_t found = histogram.Quantile(quantile).count();
    EXPECT_GE(found, values[rank]) << quantile;
    EXPECT_LE(static_cast<double>(found), static_cast<double>(values[rank]) * (1.0 + 1.0 / 1024.0))
        << quantile;
  }
  EXPECT_EQ(histogram.max().count(), values.back());
  EXPECT_EQ(histogram.count(), 20'000);
}

TEST(LatencyHistogramTest, EveryValueFallsIntoABucketThatContainsIt) {
  // Values around each boundary between buckets of different width.
  for (int bit = 0; bit <= 42; ++bit) {
    for (int64_t value = (int64_t{1} << bit) - 2; value <= (int64_t{1} << bit) + 2; ++value) {
      LatencyHistogram histogram;
      histogram.Record(nanoseconds(value));
      // Larger than all others, so that Quantile returns the bucket's upper end and not max().
      histogram.Record(nanoseconds(int64_t{1} << 43));
      const int64_t found = histogram.Quantile(0.5).count();
      EXPECT_GE(found, std::max<int64_t>(value, 0));
      EXPECT_LE(found, std::max<int64_t>(value, 0) + std::max<int64_t>(value, 0) / 1024);
    }
  }
}

TEST(LatencyHistogramTest, QuantilesOfAHundredValuesAreRanks) {
  LatencyHistogram histogram;
  for (int i = 1; i <= 100; ++i) histogram.Record(nanoseconds(i));
  EXPECT_EQ(histogram.Quantile(0.5), nanoseconds(50));
  EXPECT_EQ(histogram.Quantile(0.99), nanoseconds(99));
  EXPECT_EQ(histogram.Quantile(0.999), nanoseconds(100));
  EXPECT_EQ(histogram.mean(), nanoseconds(51));  // 50.5, rounded
}

TEST(LatencyHistogramTest, IsZeroWhenEmptyAndClampsExtremes) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.Quantile(0.99), nanoseconds(0));
  EXPECT_EQ(histogram.mean(), nanoseconds(0));
  histogram.Record(nanoseconds(-5));
  EXPECT_EQ(histogram.max(), nanoseconds(0));
  histogram.Record(std::chrono::hours(1'000));
  EXPECT_EQ(histogram.max().count(), int64_t{1} << 43);
}

}  // namespace
}  // namespace maneuver::load::latency_histogram_test
