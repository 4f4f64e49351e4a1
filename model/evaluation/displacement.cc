#include "model/evaluation/displacement.h"

#include <algorithm>
#include <limits>

namespace maneuver::evaluation {
namespace {

constexpr double kMissDistance = 2.0;  // metres

}  // namespace

double AverageDisplacement(const Trajectory& predicted, const Trajectory& truth) {
  return (predicted - truth).rowwise().norm().mean();
}

double FinalDisplacement(const Trajectory& predicted, const Trajectory& truth) {
  return (predicted.bottomRows<1>() - truth.bottomRows<1>()).norm();
}

DisplacementErrors BestOf(std::span<const Trajectory> ranked, int k, const Trajectory& truth) {
  DisplacementErrors errors{.min_ade = std::numeric_limits<double>::infinity(),
                            .min_fde = std::numeric_limits<double>::infinity()};
  for (const Trajectory& predicted : ranked.first(std::min<size_t>(k, ranked.size()))) {
    errors.min_ade = std::min(errors.min_ade, AverageDisplacement(predicted, truth));
    errors.min_fde = std::min(errors.min_fde, FinalDisplacement(predicted, truth));
  }
  errors.missed = errors.min_fde > kMissDistance;
  return errors;
}

Trajectory ConstantVelocity(double vx, double vy, std::span<const double> waypoint_times) {
  Trajectory trajectory(waypoint_times.size(), 2);
  for (size_t t = 0; t < waypoint_times.size(); ++t) {
    trajectory(t, 0) = vx * waypoint_times[t];
    trajectory(t, 1) = vy * waypoint_times[t];
  }
  return trajectory;
}

}  // namespace maneuver::evaluation
