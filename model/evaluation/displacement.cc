#include "model/evaluation/displacement.h"

#include <algorithm>
#include <limits>

namespace maneuver::evaluation {
namespace {

constexpr double kMissDistance = 2.0;  // metres, for both benchmarks
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

double AverageDisplacement(const Trajectory& predicted, const Trajectory& truth) {
  return (predicted - truth).rowwise().norm().mean();
}

double FinalDisplacement(const Trajectory& predicted, const Trajectory& truth) {
  return (predicted.bottomRows<1>() - truth.bottomRows<1>()).norm();
}

double LargestDisplacement(const Trajectory& predicted, const Trajectory& truth) {
  return (predicted - truth).rowwise().norm().maxCoeff();
}

DisplacementErrors BestOf(std::span<const Trajectory> ranked, std::span<const double> probabilities,
                          int k, const Trajectory& truth) {
  DisplacementErrors errors{.min_ade = kInfinity, .min_fde = kInfinity};
  double smallest_largest = kInfinity;
  double total = 0.0;
  double probability = 0.0;  // of the trajectory with the least FDE
  const size_t count = std::min<size_t>(k, ranked.size());
  for (size_t i = 0; i < count; ++i) {
    errors.min_ade = std::min(errors.min_ade, AverageDisplacement(ranked[i], truth));
    smallest_largest = std::min(smallest_largest, LargestDisplacement(ranked[i], truth));
    total += probabilities[i];
    const double fde = FinalDisplacement(ranked[i], truth);
    if (fde < errors.min_fde) {
      errors.min_fde = fde;
      probability = probabilities[i];
    }
  }
  const double doubt = 1.0 - (total > 0.0 ? probability / total : 0.0);
  errors.brier_fde = errors.min_fde + doubt * doubt;
  errors.missed_argoverse = errors.min_fde > kMissDistance;
  errors.missed_nuscenes = smallest_largest >= kMissDistance;
  return errors;
}

DisplacementErrors ErrorsOf(const Trajectory& predicted, const Trajectory& truth) {
  constexpr double kCertain = 1.0;
  return BestOf({&predicted, 1}, {&kCertain, 1}, 1, truth);
}

}  // namespace maneuver::evaluation
