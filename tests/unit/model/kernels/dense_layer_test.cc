#include "model/kernels/dense_layer.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::dense_layer_test {
namespace {

// Inputs and outputs: below, at and above the widths of the kernels' panels.
constexpr std::pair<int, int> kSizes[] = {{1, 1},   {5, 10},  {7, 16},   {33, 25},
                                          {64, 64}, {40, 90}, {100, 50}, {257, 129}};

bool SameBits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

// A random layer of each size, made for the target in force.
struct Problem {
  Problem(int layer_inputs, int layer_outputs)
      : inputs(layer_inputs),
        outputs(layer_outputs),
        weight(RandomValues(static_cast<size_t>(inputs * outputs), 1)),
        bias(RandomValues(static_cast<size_t>(outputs), 2)) {}

  // Rows of which an input in four is 0, in all rows or in one: as after a ReLU.
  std::vector<float> Rows(int rows) const {
    auto x = RandomValues(static_cast<size_t>(rows * inputs), 3);
    for (int r = 0; r < rows; ++r) {
      for (int i = 0; i < inputs; ++i) {
        if (i % 4 == 1 || (i + r) % 4 == 2) x[static_cast<size_t>(r * inputs + i)] = 0.0F;
      }
    }
    return x;
  }

  std::vector<float> Apply(const std::vector<float>& x, int rows, Activation activation,
                           bool bf16 = false) const {
    const DenseLayer layer(inputs, outputs, weight.data(), bias.data(), bf16);
    DenseScratch scratch;
    // What lies behind the outputs must be left alone.
    std::vector<float> y(static_cast<size_t>(rows * outputs) + 1, -7.0F);
    layer.Apply(x.data(), rows, activation, &scratch, y.data());
    EXPECT_EQ(y.back(), -7.0F);
    y.pop_back();
    return y;
  }

  const int inputs;
  const int outputs;
  std::vector<float> weight;
  std::vector<float> bias;
};

class DenseLayerTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(DenseLayerTest);

TEST_P(DenseLayerTest, IsTheMatrixProductInDoublePrecision) {
  for (const auto& [inputs, outputs] : kSizes) {
    const Problem problem(inputs, outputs);
    constexpr int kRows = 3;
    const auto x = RandomValues(static_cast<size_t>(kRows * inputs), 3);
    const auto y = problem.Apply(x, kRows, Activation::kNone);
    const auto rectified = problem.Apply(x, kRows, Activation::kRelu);
    for (int r = 0; r < kRows; ++r) {
      for (int o = 0; o < outputs; ++o) {
        double sum = problem.bias[static_cast<size_t>(o)];
        double size = std::abs(sum);
        for (int i = 0; i < inputs; ++i) {
          const double term = double{problem.weight[static_cast<size_t>(o * inputs + i)]} *
                              x[static_cast<size_t>(r * inputs + i)];
          sum += term;
          size += std::abs(term);
        }
        const size_t at = static_cast<size_t>(r * outputs + o);
        ASSERT_NEAR(y[at], sum, 1e-6 * size) << inputs << " inputs, row " << r << ", output " << o;
        ASSERT_EQ(rectified[at], std::max(0.0F, y[at]));
      }
    }
  }
}

TEST_P(DenseLayerTest, HasTheBitsOfPlain) {
  for (const auto& [inputs, outputs] : kSizes) {
    const Problem problem(inputs, outputs);
    for (const bool bf16 : {false, true}) {
      for (const Activation activation : {Activation::kNone, Activation::kRelu}) {
        for (int rows = 0; rows <= 17; ++rows) {
          const auto x = problem.Rows(rows);
          const auto apply = [&] { return problem.Apply(x, rows, activation, bf16); };
          ASSERT_TRUE(SameBits(apply(), Plain(apply)))
              << inputs << " to " << outputs << ", rows " << rows << (bf16 ? ", bf16" : ", f32");
        }
      }
    }
  }
}

TEST_P(DenseLayerTest, KeepsTheBitsOfARowInEveryBatch) {
  constexpr int kMost = 17;
  for (const auto& [inputs, outputs] : kSizes) {
    const Problem problem(inputs, outputs);
    const auto x = problem.Rows(kMost);
    std::vector<float> alone;
    for (int r = 0; r < kMost; ++r) {
      const auto begin = x.begin() + r * inputs;
      const auto y = problem.Apply({begin, begin + inputs}, 1, Activation::kNone);
      alone.insert(alone.end(), y.begin(), y.end());
    }
    for (int rows = 1; rows <= kMost; ++rows) {
      const auto y = problem.Apply(x, rows, Activation::kNone);
      ASSERT_EQ(std::memcmp(y.data(), alone.data(), y.size() * sizeof(float)), 0) << rows;
    }
  }
}

TEST_P(DenseLayerTest, RoundsNothingButWeightsInBf16) {
  for (const auto& [inputs, outputs] : kSizes) {
    const Problem problem(inputs, outputs);
    Problem rounded(inputs, outputs);
    for (float& w : rounded.weight) w = static_cast<float>(Eigen::bfloat16(w));
    const auto x = problem.Rows(4);
    EXPECT_TRUE(SameBits(problem.Apply(x, 4, Activation::kRelu, /*bf16=*/true),
                         rounded.Apply(x, 4, Activation::kRelu, /*bf16=*/false)));
  }
}

TEST_P(DenseLayerTest, KeepsNaNThroughReLU) {
  const Problem problem(5, 20);
  auto x = problem.Rows(2);
  x[0] = std::numeric_limits<float>::quiet_NaN();
  const auto y = problem.Apply(x, 2, Activation::kRelu);
  for (size_t o = 0; o < 20; ++o) {
    EXPECT_TRUE(std::isnan(y[o]));
    EXPECT_FALSE(std::isnan(y[20 + o]));
  }
}

}  // namespace
}  // namespace maneuver::kernels::dense_layer_test
