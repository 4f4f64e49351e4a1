#include "model/inference/leading_layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/unit/model/inference/convolution_problem.h"

namespace maneuver::inference::leading_layers_test {
namespace {

using artifact::BackboneLayer;

constexpr int kInputs = 8;
constexpr int kWidth = 61;
constexpr int kHeight = 17;  // as MakeProblem has it

// A raster that a few lines cross: most of its pixels are zero.
class LeadingLayersTest : public testing::TestWithParam<bool> {
 protected:
  LeadingLayersTest() {
    std::mt19937 random(5);
    std::normal_distribution<float> normal;
    int inputs = kInputs;
    int height = kHeight;
    int width = kWidth;
    for (const auto& [outputs, kernel, stride] :
         {std::tuple(24, 3, 2), std::tuple(32, 3, 2), std::tuple(16, 5, 1)}) {
      BackboneLayer layer;
      layer.kernel = kernel;
      layer.stride = stride;
      layer.relu = true;
      layer.source = static_cast<int>(layers_.size()) % 2;
      layer.destination = 1 - layer.source;
      layer.input = {inputs, height, width};
      height = (height - 1) / stride + 1;
      width = (width - 1) / stride + 1;
      layer.output = {outputs, height, width};
      FoldedConvolution folded;
      const int reads = inputs * kernel * kernel;
      folded.weight.resize(static_cast<size_t>(outputs * reads));
      const float scale =
          layers_.empty() ? 1.0F / 255.0F : 1.0F / std::sqrt(static_cast<float>(reads));
      for (float& weight : folded.weight) weight = scale * normal(random);
      folded.bias.resize(static_cast<size_t>(outputs));
      for (float& bias : folded.bias) bias = normal(random);
      layers_.push_back(layer);
      folded_.push_back(folded);
      inputs = outputs;
    }
  }

  // A few pixels around the given one.
  static Problem DotAt(int row, int column) {
    Problem problem = MakeProblem(3, 2, kInputs, 24, 1'000'000, kWidth);
    for (int y = row; y < row + 2; ++y) {
      for (int x = column; x < column + 3; ++x) {
        for (int channel = 0; channel < kInputs; channel += 3) {
          problem.raster[static_cast<size_t>((y * kWidth + x) * kInputs + channel)] =
              static_cast<uint8_t>(100 + 20 * x + channel);
        }
      }
    }
    return problem;
  }

  // Every product of all layers.
  std::vector<double> Expected(const Problem& problem) const {
    std::vector<double> values(problem.raster.begin(), problem.raster.end());
    for (size_t i = 0; i < layers_.size(); ++i) {
      const BackboneLayer& layer = layers_[i];
      std::vector<double> outputs;
      for (int row = 0; row < layer.output.height; ++row) {
        for (int column = 0; column < layer.output.width; ++column) {
          for (int o = 0; o < layer.output.channels; ++o) {
            outputs.push_back(std::max(Sum(layer, folded_[i], values, row, column, o), 0.0));
          }
        }
      }
      values = outputs;
    }
    return values;
  }

  static double Sum(const BackboneLayer& layer, const FoldedConvolution& folded,
                    const std::vector<double>& values, int row, int column, int output) {
    double sum = folded.bias[static_cast<size_t>(output)];
    const int kernel = layer.kernel;
    for (int y = 0; y < kernel; ++y) {
      for (int x = 0; x < kernel; ++x) {
        const int from_row = row * layer.stride - kernel / 2 + y;
        const int from_column = column * layer.stride - kernel / 2 + x;
        if (from_row < 0 || from_row >= layer.input.height || from_column < 0 ||
            from_column >= layer.input.width) {
          continue;
        }
        for (int i = 0; i < layer.input.channels; ++i) {
          const int weight = ((output * layer.input.channels + i) * kernel + y) * kernel + x;
          const int place = (from_row * layer.input.width + from_column) * layer.input.channels + i;
          sum += double{folded.weight[static_cast<size_t>(weight)]} *
                 values[static_cast<size_t>(place)];
        }
      }
    }
    return sum;
  }

  std::vector<float> Evaluate(const LeadingLayers& layers, const Problem& problem,
                              LeadingLayers::Scratch* scratch) const {
    std::vector<float> grid(static_cast<size_t>(layers_.back().output.values()), -1.0F);
    EXPECT_TRUE(layers.Evaluate(problem.Drawn(), scratch, grid.data()));
    return grid;
  }

  std::vector<BackboneLayer> layers_;
  std::vector<FoldedConvolution> folded_;
};
INSTANTIATE_TEST_SUITE_P(Precisions, LeadingLayersTest, testing::Bool(),
                         [](const auto& one) { return one.param ? "Bf16" : "F32"; });

TEST_P(LeadingLayersTest, SumEveryProductWhateverWasDrawnBefore) {
  const bool bf16 = GetParam();
  const size_t count = LeadingLayers::Count(layers_, bf16);
  if (bf16 && count == 1) GTEST_SKIP() << "this build does not use bf16";
  ASSERT_EQ(count, 3u);
  const LeadingLayers layers(layers_, folded_, bf16, /*narrow=*/false);
  LeadingLayers::Scratch scratch(layers);
  const std::vector<Problem> problems = {DotAt(0, 0),  DotAt(kHeight - 2, kWidth - 3),
                                         DotAt(8, 30), MakeProblem(3, 2, 8, 24, 1 << 30, kWidth),
                                         DotAt(8, 31), MakeProblem(3, 2, 8, 24, 60, kWidth)};
  for (const Problem& problem : problems) {
    const std::vector<double> expected = Expected(problem);
    const std::vector<float> grid = Evaluate(layers, problem, &scratch);
    for (size_t i = 0; i < grid.size(); ++i) {
      ASSERT_NEAR(grid[i], expected[i], (bf16 ? 0.03 : 1e-4) * (1.0 + expected[i])) << i;
    }
    // The same bits as where nothing was drawn before.
    LeadingLayers::Scratch fresh(layers);
    const std::vector<float> again = Evaluate(layers, problem, &fresh);
    ASSERT_EQ(0, std::memcmp(grid.data(), again.data(), grid.size() * sizeof(float)));
  }
}

TEST_P(LeadingLayersTest, SkipARasterThatIsFilledTooMuch) {
  const bool bf16 = GetParam();
  const auto leading = std::span(layers_).first(LeadingLayers::Count(layers_, bf16));
  const LeadingLayers layers(leading, folded_, bf16, false);
  LeadingLayers::Scratch scratch(layers);
  std::vector<float> grid(static_cast<size_t>(leading.back().output.values()));
  ASSERT_TRUE(layers.Evaluate(DotAt(3, 3).Drawn(), &scratch, grid.data()));
  const std::vector<float> before = grid;
  EXPECT_FALSE(layers.Evaluate(MakeProblem(3, 2, 8, 24, 2, kWidth).Drawn(), &scratch, grid.data()));
  ASSERT_TRUE(layers.Evaluate(DotAt(3, 3).Drawn(), &scratch, grid.data()));
  EXPECT_EQ(grid, before);
}

TEST_F(LeadingLayersTest, EndBeforeALayerThatIsReadTwiceOrFillsNoVector) {
  EXPECT_EQ(LeadingLayers::Count(layers_, false), 3u);
  layers_[2].adds = true;
  EXPECT_EQ(LeadingLayers::Count(layers_, false), 1u);
  layers_[2].adds = false;
  layers_[2].source = 1;
  EXPECT_EQ(LeadingLayers::Count(layers_, false), 2u);
  layers_[1].kind = BackboneLayer::Kind::kMaxPool;
  EXPECT_EQ(LeadingLayers::Count(layers_, false), 1u);
  layers_[0].output.channels = 25;
  EXPECT_EQ(LeadingLayers::Count(layers_, false), 0u);
}

}  // namespace
}  // namespace maneuver::inference::leading_layers_test
