#include <numeric>

#include "model/inference/action_model.h"

namespace maneuver::inference {
namespace {

v1::Trajectory ToProto(const Eigen::Ref<const Trajectory>& trajectory) {
  v1::Trajectory proto;
  proto.mutable_x()->Add(trajectory.col(0).begin(), trajectory.col(0).end());
  proto.mutable_y()->Add(trajectory.col(1).begin(), trajectory.col(1).end());
  return proto;
}

v1::ActionDistribution ToProto(const ActionDistribution& distribution, double probability) {
  v1::ActionDistribution proto;
  proto.set_action_id(distribution.action);
  proto.set_probability(probability);
  proto.mutable_latent_mean()->Add(distribution.latent_mean.begin(),
                                   distribution.latent_mean.end());
  proto.mutable_latent_stddev()->Add(distribution.latent_stddev.begin(),
                                     distribution.latent_stddev.end());
  *proto.mutable_mean_trajectory() = ToProto(distribution.mean());
  for (size_t p = 0; p < distribution.sigma.size(); ++p) {
    *proto.add_sigma_trajectories() = ToProto(distribution.sigma[p]);
  }
  v1::WaypointMoments& moments = *proto.mutable_moments();
  const auto& mean = distribution.moment_mean;
  const auto& covariance = distribution.moment_covariance;
  moments.mutable_mean_x()->Add(mean.col(0).begin(), mean.col(0).end());
  moments.mutable_mean_y()->Add(mean.col(1).begin(), mean.col(1).end());
  moments.mutable_covariance_xx()->Add(covariance.col(0).begin(), covariance.col(0).end());
  moments.mutable_covariance_xy()->Add(covariance.col(1).begin(), covariance.col(1).end());
  moments.mutable_covariance_yy()->Add(covariance.col(2).begin(), covariance.col(2).end());
  return proto;
}

}  // namespace

std::vector<v1::Action> DecodeActionSet(const ActionModel& model, std::span<const double> usage,
                                        std::span<const bool> effective, double speed) {
  std::vector<int> ids(static_cast<size_t>(model.spec().actions()));
  std::iota(ids.begin(), ids.end(), 0);
  const std::vector<ActionDistribution> distributions =
      model.NewSession()->Describe(DrivingStraight(model.spec(), speed), ids, LatentSource::kPrior);
  std::vector<v1::Action> actions(ids.size());
  for (size_t k = 0; k < ids.size(); ++k) {
    actions[k].set_action_id(ids[k]);
    actions[k].set_usage(usage[k]);
    actions[k].set_effective(effective[k]);
    *actions[k].mutable_distribution() = ToProto(distributions[k], usage[k]);
  }
  return actions;
}

}  // namespace maneuver::inference
