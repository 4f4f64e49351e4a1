#include "model/evaluation/grouped_sums.h"

#include <map>
#include <utility>
#include <vector>

#include "model/evaluation/bootstrap.h"

namespace maneuver::evaluation {
namespace {

// The figure without an interval.
//   totals: of each seed, [columns]
v1::Estimate ValueOf(const std::vector<Eigen::VectorXd>& totals, const Figure& figure) {
  v1::Estimate estimate;
  for (const Eigen::VectorXd& total : totals) {
    estimate.add_seed_values(figure(total.data()));
    estimate.set_value(estimate.value() +
                       *estimate.seed_values().rbegin() / static_cast<double>(totals.size()));
  }
  return estimate;
}

}  // namespace

Figure MeanFigure(int column) {
  return [column](const double* sums) { return sums[column] / sums[0]; };
}

Figure RatioFigure(int numerator, int denominator) {
  return [=](const double* sums) { return sums[numerator] / sums[denominator]; };
}

Figure DifferenceFigure(int ours, int theirs) {
  return [=](const double* sums) { return (sums[ours] - sums[theirs]) / sums[0]; };
}

GroupedSums::GroupedSums(int columns, int seeds)
    : columns_(columns), sums_(static_cast<size_t>(seeds)) {}

void GroupedSums::Add(size_t seed, int group, const Eigen::Ref<const Eigen::VectorXd>& row) {
  sums_[seed].try_emplace(group, Eigen::VectorXd::Zero(columns_)).first->second += row;
}

Eigen::VectorXd GroupedSums::Total(size_t seed) const {
  Eigen::VectorXd total = Eigen::VectorXd::Zero(columns_);
  for (const auto& [_, sums] : sums_[seed]) total += sums;
  return total;
}

Eigen::MatrixXd GroupedSums::Drawn(size_t seed, const Eigen::MatrixXd& draws) const {
  Eigen::MatrixXd counts(draws.rows(), static_cast<Eigen::Index>(sums_[seed].size()));
  Eigen::MatrixXd sums(columns_, counts.cols());
  Eigen::Index at = 0;
  for (const auto& [group, of_group] : sums_[seed]) {
    counts.col(at) = draws.col(group);
    sums.col(at++) = of_group;
  }
  return sums * counts.transpose();
}

Estimator::Estimator(const GroupedSums& part, const Eigen::MatrixXd& draws)
    : groups_(part.groups()) {
  for (size_t seed = 0; seed < static_cast<size_t>(part.seeds()); ++seed) {
    totals_.push_back(part.Total(seed));
    drawn_.push_back(part.Drawn(seed, draws));
  }
}

v1::Estimate Estimator::Estimate(const Figure& figure) const {
  const double seeds = static_cast<double>(totals_.size());
  v1::Estimate estimate = ValueOf(totals_, figure);
  std::vector<double> drawn(static_cast<size_t>(drawn_.front().cols()));
  for (const Eigen::MatrixXd& of_seed : drawn_) {
    for (size_t i = 0; i < drawn.size(); ++i) {
      drawn[i] += figure(of_seed.col(static_cast<Eigen::Index>(i)).data()) / seeds;
    }
  }
  const Interval interval = PercentileInterval(std::move(drawn));
  estimate.set_lower(interval.lower);
  estimate.set_upper(interval.upper);
  return estimate;
}

v1::Estimate EstimateByJackknife(const GroupedSums& part, const Figure& figure) {
  std::vector<Eigen::VectorXd> totals;
  std::map<int, double> changes;  // of the estimate, if a group is left out
  for (size_t seed = 0; seed < static_cast<size_t>(part.seeds()); ++seed) {
    totals.push_back(part.Total(seed));
    const double whole = figure(totals.back().data());
    for (const auto& [group, sums] : part.OfGroups(seed)) {
      const Eigen::VectorXd rest = totals.back() - sums;
      if (!(rest[0] > 0.0)) continue;
      changes[group] += (figure(rest.data()) - whole) / static_cast<double>(part.seeds());
    }
  }
  v1::Estimate estimate = ValueOf(totals, figure);
  std::vector<double> without;
  without.reserve(changes.size());
  for (const auto& [_, change] : changes) without.push_back(estimate.value() + change);
  const Interval interval = without.size() > 1 ? JackknifeInterval(estimate.value(), without)
                                               : Interval{estimate.value(), estimate.value()};
  estimate.set_lower(interval.lower);
  estimate.set_upper(interval.upper);
  return estimate;
}

}  // namespace maneuver::evaluation
