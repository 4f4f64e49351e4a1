// Assigns rows to columns at the least cost.

#ifndef MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_
#define MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_

#include <Eigen/Core>
#include <vector>

namespace maneuver::evaluation {

// Assigns rows to columns one to one with the least sum of costs, by shortest augmenting paths (the
// Hungarian method as in Jonker and Volgenant, "A shortest augmenting path algorithm for dense and
// sparse linear assignment problems", 1987). Takes O(n^2 m) for n rows and m >= n columns.
//   costs: [n, m], finite.
// Returns the column of each row, [n]; -1 for rows without a column if there are more rows than
// columns.
std::vector<int> LeastCostAssignment(const Eigen::MatrixXd& costs);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_
