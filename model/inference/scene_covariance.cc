#include "model/inference/scene_covariance.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "model/artifact/model_spec.h"
#include "model/inference/mean_direction.h"
#include "model/inference/stored_layers.h"

namespace maneuver::inference {

using artifact::kStddevTerms;

SceneCovariance::SceneCovariance(const v1::ModelSpec& spec, const artifact::TensorMap& weights,
                                 bool bf16)
    : networks_(StoredMlps(weights, "scene_covariance", spec.actions(), bf16)),
      factors_(Eigen::Map<const Eigen::Matrix<float, artifact::kSpeedBinCount, 2, Eigen::RowMajor>>(
                   weights.at("scene_covariance.speed_factor").values.data())
                   .cast<double>()) {
  const std::vector<double> times = artifact::WaypointTimes(spec.trajectory());
  waypoint_interval_ = artifact::WaypointInterval(spec.trajectory());
  const double horizon = times.back();
  terms_.resize(static_cast<Eigen::Index>(times.size()), kStddevTerms);
  for (size_t t = 0; t < times.size(); ++t) {
    const double share = 2.0 * times[t] / horizon;
    terms_.row(static_cast<Eigen::Index>(t)) << 1.0, std::log(share), share - 1.0,
        std::exp(-times[t]);
  }
}

size_t SceneCovariance::bytes() const {
  size_t bytes = 0;
  for (const Mlp& network : networks_) bytes += network.bytes();
  return bytes;
}

Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> SceneCovariance::Evaluate(
    const float* features, int k, const Trajectory& mean, double speed, MlpScratch* scratch) const {
  Eigen::Matrix<float, 2 * kStddevTerms, 1> numbers;
  networks_[static_cast<size_t>(k)].Apply(features, 1, scratch, numbers.data());
  const auto bin = std::upper_bound(std::begin(artifact::kSpeedBins),
                                    std::end(artifact::kSpeedBins), std::abs(speed)) -
                   std::begin(artifact::kSpeedBins);
  const auto variances = [&](const auto& of_axis, double factor) -> Eigen::ArrayXd {
    const Eigen::ArrayXd log_stddev = (terms_ * of_axis.template cast<double>()).array();
    return factor *
           (2.0 *
            log_stddev.max(double{artifact::kLeastLogStddev}).min(double{artifact::kMostLogStddev}))
               .exp();
  };
  const Eigen::ArrayXd along = variances(numbers.template head<kStddevTerms>(), factors_(bin, 0));
  const Eigen::ArrayXd across = variances(numbers.template tail<kStddevTerms>(), factors_(bin, 1));
  const Trajectory directions = MeanDirections(mean, waypoint_interval_);
  const Eigen::ArrayXd x = directions.col(0).array();
  const Eigen::ArrayXd y = directions.col(1).array();
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> covariances(mean.rows(), 3);
  covariances.col(0) = along * x * x + across * y * y;
  covariances.col(1) = (along - across) * x * y;
  covariances.col(2) = along * y * y + across * x * x;
  return covariances;
}

}  // namespace maneuver::inference
