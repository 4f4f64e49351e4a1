#include "model/inference/sparse_convolution.h"

#include <gtest/gtest.h>

#include <tuple>
#include <vector>

#include "tests/unit/model/inference/convolution_problem.h"

namespace maneuver::inference::sparse_convolution_test {
namespace {

// What the other channels have given before.
constexpr double kBefore = 0.25;

using Shape = std::tuple<int, int, int, int>;  // kernel, stride, inputs, outputs
class SparseConvolutionTest : public testing::TestWithParam<Shape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, SparseConvolutionTest,
                         testing::Values(Shape{1, 1, 4, 16}, Shape{3, 2, 13, 32},
                                         Shape{3, 1, 5, 48}, Shape{5, 2, 4, 16}, Shape{7, 2, 6, 64},
                                         Shape{7, 2, 5, 176}, Shape{3, 3, 8, 32},
                                         Shape{5, 4, 9, 16}));

TEST_P(SparseConvolutionTest, AddsTheProductsOfItsChannels) {
  const auto [kernel, stride, inputs, outputs] = GetParam();
  {
    const Problem problem = MakeProblem(kernel, stride, inputs, outputs, 16);
    ASSERT_TRUE(SparseConvolution::Takes(problem.layer));
    SparseConvolution::Values values;  // used again
    for (const int first : {0, 3}) {
      const SparseConvolution convolution(problem.layer, problem.folded, first, 0.1);
      std::vector<float> grid(static_cast<size_t>(problem.layer.output.values()), kBefore);
      const artifact::GridSize& input = problem.layer.input;
      CellMask pixels(input.height, input.width);
      ASSERT_TRUE(convolution.Find(problem.Drawn(), &values, &pixels));
      int found = 0;
      for (int row = 0; row < input.height; ++row) {
        pixels.ForEach(row, [&](int column) {
          ASSERT_EQ(values.pixels[static_cast<size_t>(found++)].column, column);
        });
        ASSERT_EQ(found, values.rows[static_cast<size_t>(row) + 1]);
      }
      for (int row = 0; row < problem.layer.output.height; ++row) {
        convolution.AddRow(values, row,
                           &grid[static_cast<size_t>(row) * problem.layer.output.width * outputs]);
      }
      size_t i = 0;
      for (int row = 0; row < problem.layer.output.height; ++row) {
        for (int column = 0; column < problem.layer.output.width; ++column) {
          for (int channel = 0; channel < outputs; ++channel, ++i) {
            ASSERT_NEAR(grid[i], kBefore + Products(problem, first, row, column, channel), 1e-4)
                << "row " << row << " column " << column << " channel " << channel;
          }
        }
      }
    }
  }
}

TEST(FilledRasterTest, SkipsARasterThatIsFilledTooMuch) {
  const Problem problem = MakeProblem(3, 2, 13, 32, 4);
  SparseConvolution::Values values;
  CellMask pixels(problem.layer.input.height, problem.layer.input.width);
  EXPECT_FALSE(SparseConvolution(problem.layer, problem.folded, 3, 0.1)
                   .Find(problem.Drawn(), &values, &pixels));
}

TEST(FilledRasterTest, IgnoresTheChannelsOfTheMap) {
  Problem problem = MakeProblem(3, 2, 13, 32, 4);
  for (size_t i = 0; i < problem.raster.size(); ++i) {
    if (i % 13 >= 3) problem.raster[i] = 0;
  }
  SparseConvolution::Values values;
  CellMask pixels(problem.layer.input.height, problem.layer.input.width);
  EXPECT_TRUE(SparseConvolution(problem.layer, problem.folded, 3, 0.1)
                  .Find(problem.Drawn(), &values, &pixels));
  EXPECT_EQ(values.count, 0);
  EXPECT_TRUE(values.pixels.empty());
}

TEST(FilledRasterTest, RefusesOutputsThatFillNoVector) {
  EXPECT_FALSE(SparseConvolution::Takes(MakeProblem(3, 2, 13, 25, 4).layer));
}

}  // namespace
}  // namespace maneuver::inference::sparse_convolution_test
