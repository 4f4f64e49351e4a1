#include "model/evaluation/assignment.h"

#include <limits>

namespace maneuver::evaluation {
namespace {

constexpr int kNobody = -1;

// Assigns a column to one more row, and moves earlier rows where that is cheaper. Keeps costs(i, j)
// - row_price[i] - column_price[j] >= 0 everywhere, and = 0 for assigned pairs.
class Assignment {
 public:
  explicit Assignment(const Eigen::MatrixXd& costs)
      : costs_(costs),
        row_price_(Eigen::VectorXd::Zero(costs.rows())),
        column_price_(Eigen::VectorXd::Zero(costs.cols())),
        row_of_(static_cast<size_t>(costs.cols()), kNobody) {}

  void Add(int new_row) {
    const Eigen::Index columns = costs_.cols();
    // Dijkstra over columns: distance[j] is the length of the cheapest path from the new row to
    // column j.
    Eigen::VectorXd distance =
        Eigen::VectorXd::Constant(columns, std::numeric_limits<double>::infinity());
    std::vector<int> previous(row_of_.size(), kNobody);  // column before j on that path
    std::vector<bool> settled(row_of_.size(), false);
    int row = new_row;
    int column = kNobody;
    double reached = 0.0;
    do {
      int nearest = kNobody;
      for (int j = 0; j < columns; ++j) {
        if (settled[static_cast<size_t>(j)]) continue;
        const double through = reached + costs_(row, j) - row_price_[row] - column_price_[j];
        if (through < distance[j]) {
          distance[j] = through;
          previous[static_cast<size_t>(j)] = column;
        }
        if (nearest == kNobody || distance[j] < distance[nearest]) nearest = j;
      }
      column = nearest;
      reached = distance[column];
      settled[static_cast<size_t>(column)] = true;
      row = row_of_[static_cast<size_t>(column)];
    } while (row != kNobody);

    row_price_[new_row] += reached;
    for (int j = 0; j < columns; ++j) {
      if (!settled[static_cast<size_t>(j)] || j == column) continue;
      column_price_[j] -= reached - distance[j];
      row_price_[row_of_[static_cast<size_t>(j)]] += reached - distance[j];
    }
    while (column != kNobody) {
      const int before = previous[static_cast<size_t>(column)];
      row_of_[static_cast<size_t>(column)] =
          before == kNobody ? new_row : row_of_[static_cast<size_t>(before)];
      column = before;
    }
  }

  // Returns the row of each column, or kNobody.
  const std::vector<int>& row_of() const { return row_of_; }

 private:
  const Eigen::MatrixXd& costs_;
  Eigen::VectorXd row_price_;
  Eigen::VectorXd column_price_;
  std::vector<int> row_of_;
};

std::vector<int> RowOfEachColumn(const Eigen::MatrixXd& costs) {
  Assignment assignment(costs);
  for (int row = 0; row < costs.rows(); ++row) assignment.Add(row);
  return assignment.row_of();
}

}  // namespace

std::vector<int> LeastCostAssignment(const Eigen::MatrixXd& costs) {
  if (costs.rows() > costs.cols()) return RowOfEachColumn(costs.transpose());
  std::vector<int> column_of(static_cast<size_t>(costs.rows()), kNobody);
  const std::vector<int> row_of = RowOfEachColumn(costs);
  for (size_t column = 0; column < row_of.size(); ++column) {
    if (row_of[column] != kNobody) {
      column_of[static_cast<size_t>(row_of[column])] = static_cast<int>(column);
    }
  }
  return column_of;
}

}  // namespace maneuver::evaluation
