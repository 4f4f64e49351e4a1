#include "model/kernels/difference_layer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "model/kernels/bf16.h"
#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::difference_layer_test {
namespace {

// Inputs and outputs: below, at and above a vector, a panel, and several.
constexpr std::pair<int, int> kSizes[] = {{1, 1},   {5, 10},    {16, 16},   {33, 25},
                                          {64, 32}, {128, 100}, {128, 128}, {257, 129}};

float Rounded(float value) { return FromBf16(ToBf16(value)); }

class DifferenceLayerTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(DifferenceLayerTest);

TEST_P(DifferenceLayerTest, IsTheProductOfWhatIsRoundedToBf16) {
  if (!DifferenceLayer::Supported()) GTEST_SKIP() << "no bf16";
  DifferenceScratch scratch;  // shared: what an earlier layer left in it must not matter
  for (const auto& [inputs, outputs] : kSizes) {
    const auto weight = RandomValues(static_cast<size_t>(inputs * outputs), 1);
    const DifferenceLayer layer(inputs, outputs, weight.data());
    ASSERT_EQ(layer.outputs(), outputs);
    for (const int rows : {1, 2, 10, 12, 13, 26}) {
      auto x = RandomValues(static_cast<size_t>(rows * inputs), 3);
      for (int r = 0; r < rows; ++r) {
        for (int i = 0; i < inputs; ++i) {
          // Every fourth input is 0 in all rows, as after a ReLU, and another fourth in some.
          if (i % 4 == 1 || (i + r) % 4 == 2) x[static_cast<size_t>(r * inputs + i)] = 0.0F;
        }
      }
      // What lies behind the outputs must be left alone.
      std::vector<float> y(static_cast<size_t>(rows * outputs) + 1, -7.0F);
      layer.Apply(x.data(), rows, &scratch, y.data());
      ASSERT_EQ(y.back(), -7.0F);
      for (int r = 0; r < rows; ++r) {
        for (int o = 0; o < outputs; ++o) {
          double sum = 0;
          double size = 0;
          for (int i = 0; i < inputs; ++i) {
            const double term = double{Rounded(weight[static_cast<size_t>(o * inputs + i)])} *
                                Rounded(x[static_cast<size_t>(r * inputs + i)]);
            sum += term;
            size += std::abs(term);
          }
          ASSERT_NEAR(y[static_cast<size_t>(r * outputs + o)], sum, 1e-6 * size)
              << inputs << " to " << outputs << ", row " << r << " of " << rows << ", output " << o;
        }
      }
    }
  }
}

TEST_P(DifferenceLayerTest, AnswersZerosForZeros) {
  if (!DifferenceLayer::Supported()) GTEST_SKIP() << "no bf16";
  const auto weight = RandomValues(40 * 20, 1);
  const DifferenceLayer layer(40, 20, weight.data());
  DifferenceScratch scratch;
  const std::vector<float> x(3 * 40);
  std::vector<float> y(3 * 20, 1.0F);
  layer.Apply(x.data(), 3, &scratch, y.data());
  EXPECT_EQ(y, std::vector<float>(3 * 20));
}

struct Pairs {
  int width;
  int count;
  std::vector<float> x;
  std::vector<float> h;
  std::vector<float> q;

  void Rectify() { RectifyDifferences(width, count, x.data(), h.data(), q.data()); }
};

Pairs RandomPairs(int width, int count) {
  Pairs pairs = {width, count, RandomValues(static_cast<size_t>(width), 1),
                 RandomValues(static_cast<size_t>(width * count), 2),
                 RandomValues(static_cast<size_t>(width * count), 3)};
  for (float& q : pairs.q) q *= 0.1F;
  return pairs;
}

TEST_P(DifferenceLayerTest, RectifiesEachPointOfAPair) {
  for (const int width : {1, 7, 16, 33, 128}) {
    const Pairs before = RandomPairs(width, 5);
    Pairs after = before;
    after.Rectify();
    for (int pair = 0; pair < before.count; ++pair) {
      for (int i = 0; i < width; ++i) {
        const size_t column = static_cast<size_t>(i);
        const size_t at = static_cast<size_t>(pair * width + i);
        ASSERT_EQ(after.x[column], std::max(0.0F, before.x[column]));
        for (const float sign : {1.0F, -1.0F}) {
          const float point = before.x[column] + before.q[at] + sign * before.h[at];
          ASSERT_NEAR(after.x[column] + after.q[at] + sign * after.h[at], std::max(0.0F, point),
                      1e-6);
        }
      }
    }
  }
}

TEST_P(DifferenceLayerTest, LeavesDifferencesThatNoReluCuts) {
  Pairs pairs = RandomPairs(50, 3);
  for (float& x : pairs.x) x = 20.0F;
  const Pairs before = pairs;
  pairs.Rectify();
  EXPECT_EQ(pairs.h, before.h);
  EXPECT_EQ(pairs.q, before.q);
  for (float& x : pairs.x) x = -20.0F;
  pairs.Rectify();
  EXPECT_EQ(pairs.h, std::vector<float>(150));
  EXPECT_EQ(pairs.q, std::vector<float>(150));
}

TEST_P(DifferenceLayerTest, RectifiesWithTheBitsOfPlain) {
  for (const int width : {1, 7, 16, 33, 128}) {
    const auto rectified = [&] {
      Pairs pairs = RandomPairs(width, 5);
      pairs.Rectify();
      return std::vector{pairs.x, pairs.h, pairs.q};
    };
    ASSERT_EQ(rectified(), Plain(rectified));
  }
}

TEST_P(DifferenceLayerTest, KeepsNaNThroughTheRelu) {
  Pairs pairs = RandomPairs(20, 1);
  pairs.x[3] = std::numeric_limits<float>::quiet_NaN();
  pairs.Rectify();
  EXPECT_TRUE(std::isnan(pairs.x[3]));
  EXPECT_TRUE(std::isnan(pairs.h[3]) || std::isnan(pairs.q[3]));
}

}  // namespace
}  // namespace maneuver::kernels::difference_layer_test
