#include "model/evaluation/generic_mean.h"

namespace maneuver::evaluation {

std::optional<inference::Trajectory> GenericMean(const v1::Action& action) {
  const v1::Trajectory& mean = action.distribution().mean_trajectory();
  if (mean.x().empty() || mean.x_size() != mean.y_size()) return std::nullopt;
  inference::Trajectory trajectory(mean.x_size(), 2);
  for (int t = 0; t < mean.x_size(); ++t) trajectory.row(t) << mean.x(t), mean.y(t);
  return trajectory;
}

}  // namespace maneuver::evaluation
