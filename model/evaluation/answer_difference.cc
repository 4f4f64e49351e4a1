#include "model/evaluation/answer_difference.h"

#include <algorithm>
#include <cmath>

#include "absl/status/status.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/action_matching.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/displacement.h"
#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

// KL(p || (p + q) / 2)
double DivergenceFromMean(const Eigen::VectorXd& p, const Eigen::VectorXd& q) {
  double divergence = 0.0;
  for (Eigen::Index k = 0; k < p.size(); ++k) {
    if (p[k] > 0.0) divergence += p[k] * std::log(2.0 * p[k] / (p[k] + q[k]));
  }
  return divergence;
}

// Mean trajectories with probabilities that sum to 1.
struct Mixture {
  std::vector<double> probabilities;
  std::vector<Trajectory> means;

  void Add(double probability, Trajectory mean) {
    probabilities.push_back(probability);
    means.push_back(std::move(mean));
  }
  void Normalize() {
    double sum = 0.0;
    for (const double p : probabilities) sum += p;
    for (double& p : probabilities) p /= sum;
  }
  Trajectory Expected() const {
    Trajectory expected = Trajectory::Zero(means.front().rows(), 2);
    for (size_t i = 0; i < means.size(); ++i) expected += probabilities[i] * means[i];
    return expected;
  }
};

// sum_ij p_i q_j d(m_i, n_j)
double ExpectedDistance(const Mixture& first, const Mixture& second) {
  double sum = 0.0;
  for (size_t i = 0; i < first.means.size(); ++i) {
    for (size_t j = 0; j < second.means.size(); ++j) {
      sum += first.probabilities[i] * second.probabilities[j] *
             AverageDisplacement(first.means[i], second.means[j]);
    }
  }
  return sum;
}

// Index of the most probable action.
size_t Likeliest(const VersionAnswer& answer) {
  size_t best = 0;
  for (size_t i = 1; i < answer.actions.size(); ++i) {
    const double gain = answer.probabilities[answer.actions[i].action] -
                        answer.probabilities[answer.actions[best].action];
    if (gain > 0.0 || (gain == 0.0 && answer.actions[i].action < answer.actions[best].action)) {
      best = i;
    }
  }
  return best;
}

}  // namespace

absl::StatusOr<AnswerComparison> AnswerComparison::Make(const v1::ModelManifest& first,
                                                        const v1::ModelManifest& second) {
  const std::vector<double> ours = artifact::WaypointTimes(first.spec().trajectory());
  const std::vector<double> theirs = artifact::WaypointTimes(second.spec().trajectory());
  AnswerComparison comparison;
  for (const double time : ours) {
    const auto later = std::ranges::lower_bound(theirs, time - scene::kSameTime);
    if (later == theirs.end()) break;
    const double before = later == theirs.begin() ? 0.0 : *(later - 1);
    Place place{.later = later - theirs.begin()};
    if (std::abs(*later - time) > scene::kSameTime) {
      place.weight = (time - before) / (*later - before);
    }
    comparison.places_.push_back(place);
  }
  comparison.times_ = static_cast<Eigen::Index>(comparison.places_.size());
  if (comparison.times_ == 0) {
    return absl::InvalidArgumentError(
        "the versions look ahead for times that have no waypoint in common");
  }
  comparison.MatchSymbols(first, second);
  return comparison;
}

void AnswerComparison::MatchSymbols(const v1::ModelManifest& first,
                                    const v1::ModelManifest& second) {
  const auto matching = MatchActions(first, second);
  if (!matching.ok()) return;
  constexpr Eigen::Index kIneffective = 0;
  first_symbols_.assign(static_cast<size_t>(first.spec().actions()), kIneffective);
  second_symbols_.assign(static_cast<size_t>(second.spec().actions()), kIneffective);
  symbols_ = 1;
  const auto set = [](std::vector<Eigen::Index>& symbols, const v1::MatchedAction& action,
                      Eigen::Index symbol) {
    const auto id = static_cast<size_t>(action.action_id());
    if (id < symbols.size()) symbols[id] = symbol;
  };
  for (const v1::ActionPair& pair : matching->pairs()) {
    set(first_symbols_, pair.first(), symbols_++);
    if (pair.distance() <= matching->tolerance()) {
      ++agreeing_pairs_;
      set(second_symbols_, pair.second(), symbols_ - 1);
    } else {
      set(second_symbols_, pair.second(), symbols_++);
    }
  }
  for (const auto& action : matching->unpaired_first()) set(first_symbols_, action, symbols_++);
  for (const auto& action : matching->unpaired_second()) set(second_symbols_, action, symbols_++);
}

Eigen::VectorXd AnswerComparison::SymbolProbabilities(const Eigen::VectorXd& probabilities,
                                                      std::span<const Eigen::Index> symbols) const {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(symbols_);
  for (size_t k = 0; k < symbols.size(); ++k) {
    sums[symbols[k]] += probabilities[static_cast<Eigen::Index>(k)];
  }
  return sums;
}

AnswerDifference AnswerComparison::Compare(const VersionAnswer& first,
                                           const VersionAnswer& second) const {
  Mixture ours;
  for (const auto& action : first.actions) {
    ours.Add(first.probabilities[action.action], action.mean().topRows(times_));
  }
  Mixture theirs;
  for (const auto& action : second.actions) {
    Trajectory mean = Trajectory::Zero(times_, 2);
    for (Eigen::Index t = 0; t < times_; ++t) {
      const auto [later, weight] = places_[static_cast<size_t>(t)];
      mean.row(t) = weight * action.mean().row(later);
      if (later > 0 && weight < 1.0) mean.row(t) += (1.0 - weight) * action.mean().row(later - 1);
    }
    theirs.Add(second.probabilities[action.action], std::move(mean));
  }
  ours.Normalize();
  theirs.Normalize();

  AnswerDifference difference;
  difference.expected = AverageDisplacement(ours.Expected(), theirs.Expected());
  difference.likeliest =
      AverageDisplacement(ours.means[Likeliest(first)], theirs.means[Likeliest(second)]);
  // Rounding can make this and the entropies slightly negative.
  difference.energy =
      std::max(0.0, 2.0 * ExpectedDistance(ours, theirs) - ExpectedDistance(ours, ours) -
                        ExpectedDistance(theirs, theirs));
  difference.first_entropy = std::max(0.0, Entropy(first.probabilities));
  difference.second_entropy = std::max(0.0, Entropy(second.probabilities));
  if (symbols_ > 0) {
    const Eigen::VectorXd p = SymbolProbabilities(first.probabilities, first_symbols_);
    const Eigen::VectorXd q = SymbolProbabilities(second.probabilities, second_symbols_);
    difference.divergence =
        std::max(0.0, (DivergenceFromMean(p, q) + DivergenceFromMean(q, p)) / 2.0);
  }
  return difference;
}

}  // namespace maneuver::evaluation
