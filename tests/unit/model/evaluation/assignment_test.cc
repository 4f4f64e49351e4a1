#include "model/evaluation/assignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <set>

namespace maneuver::evaluation::assignment_test {
namespace {

double CostOf(const Eigen::MatrixXd& costs, const std::vector<int>& columns) {
  double cost = 0.0;
  for (size_t row = 0; row < columns.size(); ++row) {
    if (columns[row] >= 0) cost += costs(static_cast<Eigen::Index>(row), columns[row]);
  }
  return cost;
}

// Tries every order of the columns; needs rows <= columns.
double LeastCostOfAll(const Eigen::MatrixXd& costs) {
  std::vector<int> columns(static_cast<size_t>(costs.cols()));
  std::iota(columns.begin(), columns.end(), 0);
  double least = std::numeric_limits<double>::infinity();
  do {
    double cost = 0.0;
    for (int row = 0; row < costs.rows(); ++row) {
      cost += costs(row, columns[static_cast<size_t>(row)]);
    }
    least = std::min(least, cost);
  } while (std::next_permutation(columns.begin(), columns.end()));
  return least;
}

Eigen::MatrixXd RandomCosts(int rows, int columns, std::mt19937& random) {
  Eigen::MatrixXd costs(rows, columns);
  for (double& cost : costs.reshaped()) {
    // Small integers, some negative: many ties.
    cost = static_cast<double>(random() % 9) - 2.0;
  }
  return costs;
}

TEST(AssignmentTest, IsAsCheapAsTheBestOfAllPermutations) {
  std::mt19937 random(1);
  for (int round = 0; round < 200; ++round) {
    const int columns = 1 + static_cast<int>(random() % 6);
    const int rows = 1 + static_cast<int>(random() % static_cast<unsigned>(columns));
    const Eigen::MatrixXd costs = RandomCosts(rows, columns, random);
    const std::vector<int> assigned = LeastCostAssignment(costs);
    ASSERT_EQ(assigned.size(), static_cast<size_t>(rows));
    EXPECT_EQ(std::set<int>(assigned.begin(), assigned.end()).size(), assigned.size());
    EXPECT_DOUBLE_EQ(CostOf(costs, assigned), LeastCostOfAll(costs)) << costs;

    // Transposed costs: the surplus rows have no column.
    const std::vector<int> turned = LeastCostAssignment(costs.transpose());
    EXPECT_EQ(std::count(turned.begin(), turned.end(), -1), columns - rows);
    EXPECT_DOUBLE_EQ(CostOf(costs.transpose(), turned), LeastCostOfAll(costs));
  }
}

TEST(AssignmentTest, GivesUpANearestPairIfThatLowersTheTotal) {
  Eigen::Matrix2d costs;
  costs << 1.0, 2.0,  //
      1.0, 9.0;
  EXPECT_EQ(LeastCostAssignment(costs), (std::vector<int>{1, 0}));
}

TEST(AssignmentTest, AssignsNothingWithoutColumns) {
  EXPECT_TRUE(LeastCostAssignment(Eigen::MatrixXd(0, 3)).empty());
  EXPECT_EQ(LeastCostAssignment(Eigen::MatrixXd(2, 0)), (std::vector<int>{-1, -1}));
}

}  // namespace
}  // namespace maneuver::evaluation::assignment_test
