// Figures from sums over examples, with intervals from the bootstrap over groups of recordings.

#ifndef MANEUVER_MODEL_EVALUATION_GROUPED_SUMS_H_
#define MANEUVER_MODEL_EVALUATION_GROUPED_SUMS_H_

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "maneuver/v1/rivals.pb.h"

namespace maneuver::evaluation {

struct BootstrapOptions {
  int resamples = 1000;
  uint64_t seed = 1;
};

// A figure from sums over examples. sums[0] is the number of examples.
using Figure = std::function<double(const double* sums)>;

// Returns the mean of a column.
Figure MeanFigure(int column);
// Returns the ratio of two columns' means.
Figure RatioFigure(int numerator, int denominator);
// Returns the mean of column `ours` minus that of `theirs`.
Figure DifferenceFigure(int ours, int theirs);

// The sums over some examples, by training seed and by group of recordings.
class GroupedSums {
 public:
  //   columns: how many numbers each example has; the first is 1
  GroupedSums(int columns, int seeds);

  // Adds an example.
  //   group: number of the group, from 0, among all groups that the bootstrap draws
  //   row: [columns]
  void Add(size_t seed, int group, const Eigen::Ref<const Eigen::VectorXd>& row);

  bool empty() const { return sums_.front().empty(); }
  int seeds() const { return static_cast<int>(sums_.size()); }
  // Returns the number of groups that have an example.
  int groups() const { return static_cast<int>(sums_.front().size()); }

  // Returns the sums over all groups. [columns]
  Eigen::VectorXd Total(size_t seed) const;
  // Returns the sums over each group, by its number. [columns] each
  const std::map<int, Eigen::VectorXd>& OfGroups(size_t seed) const { return sums_[seed]; }
  // Returns the sums over the groups of each draw. [columns, draws]
  //   draws: as DrawGroups returns them, [draws, all groups]
  Eigen::MatrixXd Drawn(size_t seed, const Eigen::MatrixXd& draws) const;

 private:
  int columns_;
  std::vector<std::map<int, Eigen::VectorXd>> sums_;  // by seed, then by group
};

// Estimates figures of one part of the examples: the mean over the seeds, and its 95 % interval.
// All parts and metrics share the same draws, so that their figures can be compared.
class Estimator {
 public:
  //   part: must have an example for each seed
  Estimator(const GroupedSums& part, const Eigen::MatrixXd& draws);

  v1::Estimate Estimate(const Figure& figure) const;
  // Returns the number of groups that have an example of the part.
  int groups() const { return groups_; }

 private:
  int groups_;
  std::vector<Eigen::VectorXd> totals_;  // of each seed
  std::vector<Eigen::MatrixXd> drawn_;   // of each seed, [columns, draws]
};

// Returns the same estimate with an interval by the jackknife over the part's groups (bootstrap.h).
// It is for figures that noise makes larger, such as a sum of absolute values: drawn groups have
// more noise than the groups themselves, so the bootstrap's interval would lie too high. The
// interval of a single group has no width.
//   part: must have an example for each seed
v1::Estimate EstimateByJackknife(const GroupedSums& part, const Figure& figure);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_GROUPED_SUMS_H_
