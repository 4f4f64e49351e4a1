#include "model/inference/first_layer.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <tuple>
#include <vector>

#include "tests/unit/model/inference/convolution_problem.h"

namespace maneuver::inference::first_layer_test {
namespace {

CellMask AllCells(const Problem& problem) {
  CellMask cells(problem.layer.output.height, problem.layer.output.width);
  cells.SetAll();
  return cells;
}

ptrdiff_t RowValues(const Problem& problem) {
  return ptrdiff_t{problem.layer.output.width} * problem.layer.output.channels;
}

// All cells, if the layer takes the raster.
bool EvaluateAll(const FirstLayer& layer, const Problem& problem, FirstLayer::Scratch* scratch,
                 void* grid) {
  const scene::Raster raster = problem.Drawn();
  if (!layer.FindNonzeroPixels(raster, scratch)) return false;
  layer.Evaluate(raster, AllCells(problem), scratch, grid, RowValues(problem));
  return true;
}

double Expected(const Problem& problem, int row, int column, int channel) {
  const double sum = problem.folded.bias[static_cast<size_t>(channel)] +
                     Products(problem, 0, row, column, channel);
  return problem.layer.relu ? std::max(sum, 0.0) : sum;
}

// Holds the grid against every product, as far as its precision goes.
template <typename Value>
void ExpectGrid(const Problem& problem, const std::vector<Value>& grid, double tolerance) {
  size_t i = 0;
  for (int row = 0; row < problem.layer.output.height; ++row) {
    for (int column = 0; column < problem.layer.output.width; ++column) {
      for (int channel = 0; channel < problem.layer.output.channels; ++channel, ++i) {
        const double expected = Expected(problem, row, column, channel);
        ASSERT_NEAR(static_cast<float>(grid[i]), expected, tolerance * (1.0 + std::abs(expected)))
            << "row " << row << " column " << column << " channel " << channel;
      }
    }
  }
}

using Shape = std::tuple<int, int, int, int>;  // kernel, stride, inputs, outputs
class FirstLayerTest : public testing::TestWithParam<Shape> {
 protected:
  // One value in `one_in` is nonzero, and none from the middle column on. Zeros are passed over; what is
  // beside them must not be.
  Problem HalfZeroProblem(int one_in) const {
    const auto [kernel, stride, inputs, outputs] = GetParam();
    Problem problem = MakeProblem(kernel, stride, inputs, outputs, one_in);
    const auto& input = problem.layer.input;
    for (int row = 0; row < input.height; ++row) {
      const auto end = problem.raster.begin() + (row + 1) * input.width * inputs;
      std::fill(end - input.width / 2 * inputs, end, uint8_t{0});
    }
    return problem;
  }
};
INSTANTIATE_TEST_SUITE_P(Shapes, FirstLayerTest,
                         testing::Values(Shape{3, 2, 13, 24}, Shape{3, 1, 5, 8},
                                         Shape{3, 2, 13, 32}, Shape{5, 2, 4, 40},
                                         Shape{7, 2, 25, 64}, Shape{3, 3, 8, 16},
                                         Shape{5, 4, 9, 72}));

TEST_P(FirstLayerTest, SumsEveryProduct) {
  for (const bool relu : {true, false}) {
    Problem problem = HalfZeroProblem(40);
    problem.layer.relu = relu;
    ASSERT_TRUE(FirstLayer::Supports(problem.layer));
    const FirstLayer wide(problem.layer, problem.folded, false);
    const FirstLayer narrow(problem.layer, problem.folded, true);
    FirstLayer::Scratch scratch(wide);  // used again
    const size_t size = static_cast<size_t>(problem.layer.output.values());
    std::vector<float> floats(size);
    std::vector<Eigen::bfloat16> halves(size);
    for (const int one_in : {40, 60}) {
      problem.raster = HalfZeroProblem(one_in).raster;
      ASSERT_TRUE(EvaluateAll(wide, problem, &scratch, floats.data()));
      ExpectGrid(problem, floats, 1e-5);
      ASSERT_TRUE(EvaluateAll(narrow, problem, &scratch, halves.data()));
      ExpectGrid(problem, halves, 1.0 / 256);
    }
  }
}

TEST_P(FirstLayerTest, AnAllZeroRasterLeavesTheBias) {
  Problem problem = HalfZeroProblem(40);
  std::fill(problem.raster.begin(), problem.raster.end(), uint8_t{0});
  std::vector<float> grid(static_cast<size_t>(problem.layer.output.values()));
  const FirstLayer layer(problem.layer, problem.folded, false);
  FirstLayer::Scratch scratch(layer);
  ASSERT_TRUE(EvaluateAll(layer, problem, &scratch, grid.data()));
  ExpectGrid(problem, grid, 0.0);
}

// Rows lie further apart than they are wide.
TEST_P(FirstLayerTest, CellsThatAreAskedForAreTheSameToTheBitAndNoOthersAreNeeded) {
  const Problem problem = HalfZeroProblem(60);
  const scene::Raster raster = problem.Drawn();
  const artifact::GridSize& input = problem.layer.input;
  const artifact::GridSize& output = problem.layer.output;
  const FirstLayer layer(problem.layer, problem.folded, false);
  FirstLayer::Scratch scratch(layer);
  std::vector<float> all(static_cast<size_t>(output.values()));
  ASSERT_TRUE(EvaluateAll(layer, problem, &scratch, all.data()));
  CellMask pixels(input.height, input.width);
  pixels.SetPixels(raster, input.channels);
  for (int row = 0; row < input.height; ++row) {
    for (int column = 0; column < input.width; ++column) {
      ASSERT_EQ(scratch.pixels().Has(row, column), pixels.Has(row, column));
    }
  }
  CellMask seen(output.height, output.width);
  seen.SetDependent(pixels, problem.layer);
  const ptrdiff_t apart = RowValues(problem) + 5;
  std::vector<float> some(static_cast<size_t>(output.height * apart), -1.0F);
  ASSERT_TRUE(layer.FindNonzeroPixels(raster, &scratch));
  layer.Evaluate(raster, seen, &scratch, some.data(), apart);
  int left = 0;
  for (int row = 0; row < output.height; ++row) {
    for (int place = 0; place < apart; ++place) {
      const float value = some[static_cast<size_t>(row * apart + place)];
      if (place >= RowValues(problem)) {
        ASSERT_EQ(value, -1.0F);
      } else if (seen.Has(row, place / output.channels) || value != -1.0F) {
        ASSERT_EQ(value, all[static_cast<size_t>(row * RowValues(problem) + place)]);
      } else {
        ++left;
      }
    }
  }
  EXPECT_GT(left, 0);
}

// Blocks of a raster's rows are 16 pixels there.
TEST(WideFirstLayerTest, SumsEveryProduct) {
  const Problem problem = MakeProblem(3, 2, 5, 8, 40, 605);
  ASSERT_GT(problem.Drawn().block_pixels(), scene::Raster::kLanes);
  std::vector<float> grid(static_cast<size_t>(problem.layer.output.values()));
  const FirstLayer layer(problem.layer, problem.folded, false);
  FirstLayer::Scratch scratch(layer);
  ASSERT_TRUE(EvaluateAll(layer, problem, &scratch, grid.data()));
  ExpectGrid(problem, grid, 1e-5);
}

TEST(FilledFirstLayerTest, SkipsAFilledRasterSoonerInBf16) {
  const Problem problem = MakeProblem(3, 2, 13, 24, 16);  // between .05 and .1
  const FirstLayer wide(problem.layer, problem.folded, false);
  const FirstLayer narrow(problem.layer, problem.folded, true);
  FirstLayer::Scratch scratch(wide);
  EXPECT_FALSE(narrow.FindNonzeroPixels(problem.Drawn(), &scratch));
  EXPECT_TRUE(wide.FindNonzeroPixels(problem.Drawn(), &scratch));
}

TEST(FirstLayerKindTest, RefusesALayerThatReadsNoAgentsOrFillsNoVector) {
  EXPECT_TRUE(FirstLayer::Supports(MakeProblem(3, 2, 13, 24, 4).layer));
  EXPECT_FALSE(FirstLayer::Supports(MakeProblem(3, 2, 13, 25, 4).layer));
  EXPECT_FALSE(FirstLayer::Supports(MakeProblem(3, 2, 3, 24, 4).layer));
  EXPECT_FALSE(FirstLayer::Supports(MakeProblem(1, 1, 13, 24, 4).layer));
}

}  // namespace
}  // namespace maneuver::inference::first_layer_test
