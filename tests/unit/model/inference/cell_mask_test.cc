#include "model/inference/cell_mask.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <tuple>
#include <vector>

#include "tests/unit/model/inference/convolution_problem.h"

namespace maneuver::inference::cell_mask_test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::vector<int> Columns(const CellMask& mask, int row) {
  std::vector<int> columns;
  mask.ForEach(row, [&columns](int column) { columns.push_back(column); });
  return columns;
}

TEST(CellMaskTest, IsEmptyAtFirstAndFullAfterSetAll) {
  CellMask mask(3, 70);
  EXPECT_FALSE(mask.HasAny(2));
  EXPECT_THAT(Columns(mask, 2), IsEmpty());
  mask.SetAll();
  for (int row = 0; row < 3; ++row) {
    EXPECT_TRUE(mask.HasAny(row));
    EXPECT_EQ(Columns(mask, row).size(), 70u);
  }
  EXPECT_EQ(Columns(mask, 0).back(), 69);
}

TEST(CellMaskTest, LeavesOutCellsThatAnotherMaskHas) {
  Problem problem = MakeProblem(3, 1, 4, 8, 1'000'000, 70);
  const auto fill = [&problem](int column) {
    problem.raster[static_cast<size_t>((2 * 70 + column) * 4)] = 1;
  };
  CellMask one(17, 70);
  CellMask both(17, 70);
  fill(5);
  fill(65);
  one.SetPixels(problem.Drawn(), problem.layer.input.channels);
  fill(7);
  fill(69);
  both.SetPixels(problem.Drawn(), problem.layer.input.channels);
  std::vector<int> columns;
  both.ForEachWithout(one, 2, [&columns](int column) { columns.push_back(column); });
  EXPECT_THAT(columns, ElementsAre(7, 69));
}

TEST(CellMaskTest, HasAnyLooksAtNeighboursTogether) {
  Problem problem = MakeProblem(3, 1, 4, 8, 1'000'000, 70);
  problem.raster[static_cast<size_t>((2 * 70 + 66) * 4 + 3)] = 1;
  CellMask mask(17, 70);
  mask.SetPixels(problem.Drawn(), problem.layer.input.channels);
  EXPECT_THAT(Columns(mask, 2), ElementsAre(66));
  EXPECT_TRUE(mask.HasAny(2, 64, 4));
  EXPECT_TRUE(mask.HasAny(2, 66, 1));
  EXPECT_FALSE(mask.HasAny(2, 64, 2));
  EXPECT_FALSE(mask.HasAny(2, 67, 3));
  EXPECT_FALSE(mask.HasAny(3, 64, 4));
}

TEST(CellMaskTest, HasAnyOfLooksAtColumnsEvenOutsideTheGrid) {
  CellMask mask(2, 200);
  for (const int column : {3, 130}) mask.Add(1, column);
  for (int begin = -5; begin < 205; ++begin) {
    for (const int count : {0, 1, 4, 60, 64, 65, 140}) {
      const int end = begin + count;
      const bool expected = (begin <= 3 && 3 < end) || (begin <= 130 && 130 < end);
      ASSERT_EQ(mask.HasAnyOf(1, begin, end), expected) << begin << " to " << end;
    }
  }
  EXPECT_FALSE(mask.HasAnyOf(0, 0, 200));
}

TEST(CellMaskTest, CanIgnoreChannelsAfterTheFirst) {
  Problem problem = MakeProblem(3, 1, 4, 8, 1'000'000, 70);
  problem.raster[static_cast<size_t>((2 * 70 + 66) * 4 + 3)] = 1;
  CellMask mask(17, 70);
  mask.SetPixels(problem.Drawn(), 3);
  EXPECT_FALSE(mask.HasAny(2));
}

class CellMaskWidthTest : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Widths, CellMaskWidthTest, testing::Values(22, 64, 65, 130, 605));

TEST_P(CellMaskWidthTest, HasTheNonzeroPixels) {
  const int width = GetParam();
  CellMask mask(17, width);
  mask.SetAll();  // what was there before is gone
  const Problem problem = MakeProblem(3, 1, 5, 8, 90, width);
  mask.SetPixels(problem.Drawn(), problem.layer.input.channels);
  int nonzero = 0;
  for (int row = 0; row < 17; ++row) {
    for (int column = 0; column < width; ++column) {
      const auto pixel = problem.raster.begin() + (row * width + column) * 5;
      const bool expected = std::any_of(pixel, pixel + 5, [](uint8_t value) { return value != 0; });
      ASSERT_EQ(mask.Has(row, column), expected) << "row " << row << " column " << column;
      nonzero += expected ? 1 : 0;
    }
  }
  EXPECT_GT(nonzero, 0);
  EXPECT_LT(nonzero, 17 * width / 10);
}

using Shape = std::tuple<int, int, int>;  // kernel, stride, width
class SeenCellsTest : public testing::TestWithParam<Shape> {};
INSTANTIATE_TEST_SUITE_P(Shapes, SeenCellsTest,
                         testing::Combine(testing::Values(1, 2, 3, 5, 7), testing::Values(1, 2, 3),
                                          testing::Values(22, 64, 65, 126, 128, 130, 256)));

TEST_P(SeenCellsTest, HasTheCellsWhoseKernelsMeetASetCell) {
  const auto [kernel, stride, width] = GetParam();
  const Problem problem = MakeProblem(3, 1, 4, 8, 250, width);
  CellMask input(17, width);
  input.SetPixels(problem.Drawn(), problem.layer.input.channels);
  artifact::BackboneLayer layer;
  layer.kernel = kernel;
  layer.stride = stride;
  const auto size = [&layer](int cells) {
    return (cells + 2 * (layer.kernel / 2) - layer.kernel) / layer.stride + 1;
  };
  CellMask seen(size(17), size(width));
  seen.SetAll();
  seen.SetDependent(input, layer);
  for (int row = 0; row < seen.height(); ++row) {
    std::vector<int> expected;
    for (int column = 0; column < seen.width(); ++column) {
      bool any = false;
      for (int y = row * stride - kernel / 2; y < row * stride - kernel / 2 + kernel; ++y) {
        for (int x = column * stride - kernel / 2; x < column * stride - kernel / 2 + kernel; ++x) {
          any |= y >= 0 && y < 17 && x >= 0 && x < width && input.Has(y, x);
        }
      }
      if (any) expected.push_back(column);
    }
    ASSERT_EQ(Columns(seen, row), expected) << "row " << row;
    ASSERT_EQ(seen.HasAny(row), !expected.empty());
  }
}

}  // namespace
}  // namespace maneuver::inference::cell_mask_test
