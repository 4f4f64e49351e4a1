// Who goes with whom, at least cost.

#ifndef MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_
#define MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_

#include <Eigen/Core>
#include <vector>

namespace maneuver::evaluation {

// One-to-one assignment of rows to columns with the least sum of costs, by shortest augmenting
// paths (the Hungarian method as in Jonker and Volgenant, "A shortest augmenting path algorithm for
// dense and sparse linear assignment problems", 1987): O(n^2 m) for n rows and m >= n columns.
//   costs: [n, m], finite
// Returns the column of each row, [n]; with more rows than columns -1 for those left over.
std::vector<int> LeastCostAssignment(const Eigen::MatrixXd& costs);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ASSIGNMENT_H_
