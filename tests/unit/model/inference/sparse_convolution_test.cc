#include "model/inference/sparse_convolution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <tuple>
#include <vector>

namespace maneuver::inference {
namespace {

using artifact::BackboneLayer;

struct Problem {
  BackboneLayer layer;
  FoldedConvolution folded;
  std::vector<uint8_t> raster;
};

// A raster of which one value in `one_in` is filled, at random.
Problem MakeProblem(int kernel, int stride, int inputs, int outputs, int one_in) {
  std::mt19937 random(kernel * 1000 + stride * 100 + inputs * 10 + outputs);
  Problem problem;
  BackboneLayer& layer = problem.layer;
  layer.kernel = kernel;
  layer.stride = stride;
  layer.input = {inputs, 17, 22};
  layer.output = {outputs, (17 - 1) / stride + 1, (22 - 1) / stride + 1};
  std::normal_distribution<float> normal;
  problem.folded.weight.resize(static_cast<size_t>(outputs) * inputs * kernel * kernel);
  problem.folded.bias.resize(outputs);
  for (float& weight : problem.folded.weight) weight = normal(random) / 255.0F;
  for (float& bias : problem.folded.bias) bias = normal(random);
  problem.raster.resize(static_cast<size_t>(layer.input.values()));
  for (uint8_t& byte : problem.raster) {
    byte = random() % one_in == 0 ? static_cast<uint8_t>(1 + random() % 255) : 0;
  }
  return problem;
}

// What the other channels have given before.
constexpr float kBefore = 0.25F;

// Every product of the channels from `first` on, one after the other.
double Output(const Problem& problem, int first, int row, int column, int channel) {
  const BackboneLayer& layer = problem.layer;
  double sum = kBefore;
  for (int i = first; i < layer.input.channels; ++i) {
    for (int y = 0; y < layer.kernel; ++y) {
      for (int x = 0; x < layer.kernel; ++x) {
        const int from_row = row * layer.stride - layer.kernel / 2 + y;
        const int from_column = column * layer.stride - layer.kernel / 2 + x;
        if (from_row < 0 || from_row >= layer.input.height || from_column < 0 ||
            from_column >= layer.input.width) {
          continue;
        }
        const size_t weight =
            ((static_cast<size_t>(channel) * layer.input.channels + i) * layer.kernel + y) *
                layer.kernel +
            x;
        const size_t place = (static_cast<size_t>(from_row) * layer.input.width + from_column) *
                                 layer.input.channels +
                             i;
        sum += double{problem.folded.weight[weight]} * problem.raster[place];
      }
    }
  }
  return layer.relu && sum < 0.0 ? 0.0 : sum;
}

using Shape = std::tuple<int, int, int, int>;  // kernel, stride, inputs, outputs
class SparseConvolutionTest : public testing::TestWithParam<Shape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, SparseConvolutionTest,
                         testing::Values(Shape{1, 1, 4, 16}, Shape{3, 2, 13, 32},
                                         Shape{3, 1, 5, 48}, Shape{5, 2, 4, 16}, Shape{7, 2, 6, 64},
                                         Shape{7, 2, 5, 176}, Shape{3, 3, 8, 32},
                                         Shape{5, 4, 9, 16}));

TEST_P(SparseConvolutionTest, AddsWhatTheChannelsGive) {
  const auto [kernel, stride, inputs, outputs] = GetParam();
  for (const bool relu : {true, false}) {
    Problem problem = MakeProblem(kernel, stride, inputs, outputs, 16);
    problem.layer.relu = relu;
    ASSERT_TRUE(SparseConvolution::Takes(problem.layer));
    SparseConvolution::Values values;  // used again
    for (const int first : {0, 3}) {
      const SparseConvolution convolution(problem.layer, problem.folded, first);
      std::vector<float> grid(static_cast<size_t>(problem.layer.output.values()), kBefore);
      ASSERT_TRUE(convolution.Find(problem.raster.data(), &values));
      convolution.AddTo(values, grid.data());
      size_t i = 0;
      for (int row = 0; row < problem.layer.output.height; ++row) {
        for (int column = 0; column < problem.layer.output.width; ++column) {
          for (int channel = 0; channel < outputs; ++channel, ++i) {
            ASSERT_NEAR(grid[i], Output(problem, first, row, column, channel), 1e-4)
                << "row " << row << " column " << column << " channel " << channel;
          }
        }
      }
    }
  }
}

TEST(FilledRasterTest, IsLeftToBeConvolvedWhole) {
  const Problem problem = MakeProblem(3, 2, 13, 32, 4);
  SparseConvolution::Values values;
  EXPECT_FALSE(
      SparseConvolution(problem.layer, problem.folded, 3).Find(problem.raster.data(), &values));
}

TEST(FilledRasterTest, TheChannelsOfTheMapDoNotCount) {
  Problem problem = MakeProblem(3, 2, 13, 32, 4);
  for (size_t i = 0; i < problem.raster.size(); ++i) {
    if (i % 13 >= 3) problem.raster[i] = 0;
  }
  SparseConvolution::Values values;
  EXPECT_TRUE(
      SparseConvolution(problem.layer, problem.folded, 3).Find(problem.raster.data(), &values));
  EXPECT_TRUE(values.values.empty());
}

TEST(FilledRasterTest, OutputsThatFillNoVectorAreNotTaken) {
  EXPECT_FALSE(SparseConvolution::Takes(MakeProblem(3, 2, 13, 25, 4).layer));
}

}  // namespace
}  // namespace maneuver::inference
