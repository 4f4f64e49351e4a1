#include "model/inference/cell_convolution.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <tuple>
#include <vector>

#include "model/inference/packet.h"

namespace maneuver::inference {
namespace {

using Cell = CellConvolution::Cell;
using Shape = std::tuple<int, int, int, int>;  // kernel, stride, inputs, outputs

constexpr int kHeight = 9;
constexpr int kWidth = 11;

// A random input with its padding, and every third cell of the output.
class CellConvolutionTest : public testing::TestWithParam<Shape> {
 protected:
  CellConvolutionTest() {
    const auto [kernel, stride, inputs, outputs] = GetParam();
    layer_.kernel = kernel;
    layer_.stride = stride;
    layer_.relu = true;
    layer_.input = {inputs, kHeight, kWidth};
    layer_.output = {outputs, (kHeight - 1) / stride + 1, (kWidth - 1) / stride + 1};
    // Numbers that bf16 has, so that both precisions are held against the same.
    std::normal_distribution<float> normal;
    const auto random = [&] { return static_cast<float>(Eigen::bfloat16(normal(random_))); };
    folded_.weight.resize(static_cast<size_t>(outputs) * inputs * kernel * kernel);
    for (float& weight : folded_.weight) weight = random();
    folded_.bias.resize(static_cast<size_t>(outputs));
    for (float& bias : folded_.bias) bias = normal(random_);
    padding_ = kernel / 2;
    row_values_ = (kWidth + 2 * padding_) * inputs;
    input_.resize(static_cast<size_t>((kHeight + 2 * padding_) * row_values_));
    for (int row = 0; row < kHeight; ++row) {
      for (int i = 0; i < kWidth * inputs; ++i) {
        input_[static_cast<size_t>((row + padding_) * row_values_ + padding_ * inputs + i)] =
            random();
      }
    }
    const int cells = layer_.output.height * layer_.output.width;
    for (int cell = 0; cell < cells; cell += 3) cells_.push_back(CellAt(cell));
  }

  Cell CellAt(int cell) const {
    const int row = cell / layer_.output.width;
    const int column = cell % layer_.output.width;
    return {(row * row_values_ + column * layer_.input.channels) * layer_.stride,
            ptrdiff_t{cell} * layer_.output.channels};
  }

  double Expected(const Cell& cell, int output) const {
    double sum = folded_.bias[static_cast<size_t>(output)];
    const int kernel = layer_.kernel;
    for (int y = 0; y < kernel; ++y) {
      for (int x = 0; x < kernel; ++x) {
        for (int i = 0; i < layer_.input.channels; ++i) {
          const auto weight = ((output * layer_.input.channels + i) * kernel + y) * kernel + x;
          const auto place = cell.input + y * row_values_ + x * layer_.input.channels + i;
          sum += double{folded_.weight[static_cast<size_t>(weight)]} *
                 input_[static_cast<size_t>(place)];
        }
      }
    }
    return layer_.relu ? std::max(sum, 0.0) : sum;
  }

  // What a convolution writes to a grid of -1.
  template <typename Input, typename Output>
  std::vector<Output> Evaluate(std::span<const Cell> cells) const {
    const bool bf16 = sizeof(Input) == 2;
    const CellConvolution convolution(layer_, folded_, bf16, sizeof(Output) == 2);
    const std::vector<Input> input(input_.begin(), input_.end());
    std::vector<Output> output(static_cast<size_t>(layer_.output.values()), Output(-1.0F));
    convolution.Evaluate(input.data(), row_values_, cells, output.data());
    return output;
  }

  template <typename Input, typename Output>
  void ExpectEveryProduct(double tolerance) const {
    const auto output = Evaluate<Input, Output>(cells_);
    std::vector<bool> asked(output.size());
    for (const Cell& cell : cells_) {
      for (int o = 0; o < layer_.output.channels; ++o) {
        const size_t place = static_cast<size_t>(cell.output + o);
        const double expected = Expected(cell, o);
        ASSERT_NEAR(static_cast<float>(output[place]), expected,
                    tolerance * (1.0 + std::abs(expected)));
        asked[place] = true;
      }
    }
    for (size_t i = 0; i < output.size(); ++i) {
      ASSERT_TRUE(asked[i] || static_cast<float>(output[i]) == -1.0F);
    }
  }

  template <typename Input>
  void ExpectTheSameAlone() const {
    const auto together = Evaluate<Input, float>(cells_);
    for (const Cell& cell : cells_) {
      const auto alone = Evaluate<Input, float>({&cell, 1});
      for (int o = 0; o < layer_.output.channels; ++o) {
        const size_t place = static_cast<size_t>(cell.output + o);
        ASSERT_EQ(alone[place], together[place]);
      }
    }
  }

  std::mt19937 random_{7};
  artifact::BackboneLayer layer_;
  FoldedConvolution folded_;
  int padding_ = 0;
  ptrdiff_t row_values_ = 0;
  std::vector<float> input_;
  std::vector<Cell> cells_;
};
// Of vectors of outputs 1, 2, 3, 4, 5 and 6 with AVX-512, and twice as many with AVX2.
INSTANTIATE_TEST_SUITE_P(Shapes, CellConvolutionTest,
                         testing::Values(Shape{3, 2, 4, 16}, Shape{3, 1, 6, 32},
                                         Shape{3, 2, 24, 48}, Shape{5, 2, 8, 64},
                                         Shape{1, 1, 10, 80}, Shape{3, 2, 64, 96}));

TEST_P(CellConvolutionTest, IsEveryProductAndNothingElseIsWritten) {
  ASSERT_TRUE(CellConvolution::Takes(layer_, false));
  for (const bool relu : {true, false}) {
    layer_.relu = relu;
    ExpectEveryProduct<float, float>(1e-4);
  }
}

TEST_P(CellConvolutionTest, ACellIsTheSameAlone) { ExpectTheSameAlone<float>(); }

TEST_P(CellConvolutionTest, Bf16IsEveryProductToo) {
  if (!CellConvolution::Takes(layer_, true)) GTEST_SKIP() << "this build does not use bf16";
  for (const bool relu : {true, false}) {
    layer_.relu = relu;
    ExpectEveryProduct<Eigen::bfloat16, float>(1e-4);
    ExpectEveryProduct<Eigen::bfloat16, Eigen::bfloat16>(1.0 / 200);
  }
  ExpectTheSameAlone<Eigen::bfloat16>();
}

TEST(CellConvolutionKindTest, WhatFillsNoVectorOrAddsIsNotTaken) {
  artifact::BackboneLayer layer;
  layer.kernel = 3;
  layer.input = {8, 4, 4};
  layer.output = {kPacket, 4, 4};
  EXPECT_TRUE(CellConvolution::Takes(layer, false));
  layer.output.channels = kPacket + 1;
  EXPECT_FALSE(CellConvolution::Takes(layer, false));
  layer.output.channels = kPacket;
  layer.adds = true;
  EXPECT_FALSE(CellConvolution::Takes(layer, false));
  layer.adds = false;
  layer.input.channels = 7;
  EXPECT_TRUE(CellConvolution::Takes(layer, false));
  EXPECT_FALSE(CellConvolution::Takes(layer, true));
  layer.kind = artifact::BackboneLayer::Kind::kMaxPool;
  EXPECT_FALSE(CellConvolution::Takes(layer, false));
}

}  // namespace
}  // namespace maneuver::inference
