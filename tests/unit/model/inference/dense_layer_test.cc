#include "model/inference/dense_layer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

namespace maneuver::inference {
namespace {

std::vector<float> RandomValues(size_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  std::vector<float> values(count);
  for (float& value : values) value = normal(random);
  return values;
}

// Sizes below, at and above the widths of the kernel's tiles.
class DenseLayerTest : public testing::TestWithParam<std::pair<int, int>> {
 protected:
  const int inputs_ = GetParam().first;
  const int outputs_ = GetParam().second;
  const std::vector<float> weight_ = RandomValues(static_cast<size_t>(inputs_ * outputs_), 1);
  const std::vector<float> bias_ = RandomValues(static_cast<size_t>(outputs_), 2);
  const DenseLayer layer_{inputs_, outputs_, weight_.data(), bias_.data()};

  DenseScratch scratch_;  // used again

  std::vector<float> Apply(const std::vector<float>& x, int rows, Activation activation) {
    // What lies behind the outputs must be left alone.
    std::vector<float> y(static_cast<size_t>(rows * outputs_) + 1, -7.0f);
    layer_.Apply(x.data(), rows, activation, &scratch_, y.data());
    EXPECT_EQ(y.back(), -7.0f);
    y.pop_back();
    return y;
  }
};

TEST_P(DenseLayerTest, IsTheMatrixProductInDoublePrecision) {
  for (int rows = 1; rows <= 13; ++rows) {
    const auto x = RandomValues(static_cast<size_t>(rows * inputs_), 3);
    const auto y = Apply(x, rows, Activation::kNone);
    const auto rectified = Apply(x, rows, Activation::kRelu);
    for (int r = 0; r < rows; ++r) {
      for (int o = 0; o < outputs_; ++o) {
        double sum = bias_[static_cast<size_t>(o)];
        double size = std::abs(sum);
        for (int i = 0; i < inputs_; ++i) {
          const double term = double{weight_[static_cast<size_t>(o * inputs_ + i)]} *
                              x[static_cast<size_t>(r * inputs_ + i)];
          sum += term;
          size += std::abs(term);
        }
        const size_t at = static_cast<size_t>(r * outputs_ + o);
        ASSERT_NEAR(y[at], sum, 1e-6 * size) << rows << " rows, row " << r << ", output " << o;
        ASSERT_EQ(rectified[at], std::max(0.0f, y[at]));
      }
    }
  }
}

TEST_P(DenseLayerTest, NoRowsGiveNone) { EXPECT_TRUE(Apply({}, 0, Activation::kRelu).empty()); }

TEST_P(DenseLayerTest, ARowHasTheSameBitsInEveryBatch) {
  const int most = 17;
  const auto x = RandomValues(static_cast<size_t>(most * inputs_), 4);
  std::vector<float> alone;
  for (int r = 0; r < most; ++r) {
    const auto begin = x.begin() + r * inputs_;
    const auto y = Apply({begin, begin + inputs_}, 1, Activation::kNone);
    alone.insert(alone.end(), y.begin(), y.end());
  }
  for (int rows = 1; rows <= most; ++rows) {
    const auto y = Apply(x, rows, Activation::kNone);
    ASSERT_EQ(std::memcmp(y.data(), alone.data(), y.size() * sizeof(float)), 0) << rows;
  }
}

// Of an input in four, of all rows or of one, nothing is left: as after a ReLU.
TEST_P(DenseLayerTest, InputsThatArePassedOverChangeNoBit) {
  for (const int rows : {1, 2, 3, 5, 8, 13}) {
    auto x = RandomValues(static_cast<size_t>(rows * inputs_), 5);
    for (int r = 0; r < rows; ++r) {
      for (int i = 0; i < inputs_; ++i) {
        if (i % 4 == 1 || (i + r) % 4 == 2) x[static_cast<size_t>(r * inputs_ + i)] = 0.0f;
      }
    }
    const auto y = Apply(x, rows, Activation::kNone);
    for (int r = 0; r < rows; ++r) {
      for (int o = 0; o < outputs_; ++o) {
        float sum = bias_[static_cast<size_t>(o)];
        for (int i = 0; i < inputs_; ++i) {
          sum = std::fma(x[static_cast<size_t>(r * inputs_ + i)],
                         weight_[static_cast<size_t>(o * inputs_ + i)], sum);
        }
        ASSERT_EQ(y[static_cast<size_t>(r * outputs_ + o)], sum) << rows << " rows, row " << r;
      }
    }
  }
}

TEST_P(DenseLayerTest, InBf16OnlyWeightsAreRounded) {
  std::vector<float> rounded;
  for (const float w : weight_) rounded.push_back(static_cast<float>(Eigen::bfloat16(w)));
  const DenseLayer narrow(inputs_, outputs_, weight_.data(), bias_.data(), true);
  const DenseLayer wide(inputs_, outputs_, rounded.data(), bias_.data(), false);
  for (const int rows : {1, 2, 4, 9}) {
    const auto x = RandomValues(static_cast<size_t>(rows * inputs_), 6);
    std::vector<float> ours(static_cast<size_t>(rows * outputs_));
    std::vector<float> expected(ours.size());
    narrow.Apply(x.data(), rows, Activation::kRelu, &scratch_, ours.data());
    wide.Apply(x.data(), rows, Activation::kRelu, &scratch_, expected.data());
    ASSERT_EQ(ours, expected) << rows;
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, DenseLayerTest,
                         testing::Values(std::pair(1, 1), std::pair(5, 10), std::pair(7, 16),
                                         std::pair(33, 25), std::pair(64, 64), std::pair(100, 50),
                                         std::pair(257, 129)));

}  // namespace
}  // namespace maneuver::inference
