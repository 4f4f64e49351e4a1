#include "model/inference/sparse_convolution.h"

#include <gtest/gtest.h>

#include <tuple>
#include <vector>

#include "model/scene/nonzero_search.h"
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
    ASSERT_TRUE(SparseConvolution::Supports(problem.layer));
    const SparseConvolution convolution(problem.layer, problem.folded);
    scene::NonzeroSearch search;
    kernels::NonzeroValues values;  // used again
    for (const int first : {0, 3}) {
      std::vector<float> grid(static_cast<size_t>(problem.layer.output.values()), kBefore);
      ASSERT_TRUE(search.Find(problem.Drawn(), first, problem.layer.input.values(), &values));
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

TEST(SparseConvolutionTakesTest, RefusesOutputsThatFillNoVector) {
  EXPECT_FALSE(SparseConvolution::Supports(MakeProblem(3, 2, 13, 25, 4).layer));
}

}  // namespace
}  // namespace maneuver::inference::sparse_convolution_test
