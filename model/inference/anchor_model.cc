#include "model/inference/anchor_model.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/inference/stored_layers.h"

namespace maneuver::inference {
namespace {

using artifact::AnchorGaussian;
using artifact::Tensor;
using artifact::TensorMap;

// Returns nullptr for anchors without a regression.
std::unique_ptr<const Mlp> MakeRegression(const TensorMap& weights) {
  if (!weights.contains("anchor_regression.0.weight")) return nullptr;
  return std::make_unique<const Mlp>(StoredMlp(weights, "anchor_regression", /*bf16=*/false));
}

}  // namespace

AnchorModel::AnchorModel(std::shared_ptr<const ActionModel> scenes, const TensorMap& weights)
    : scenes_(std::move(scenes)), regression_(MakeRegression(weights)) {
  const Tensor& mean = weights.at("anchors.mean");
  const Eigen::Index waypoints = mean.shape[1];
  for (Eigen::Index k = 0; k < mean.shape[0]; ++k) {
    anchors_.push_back(Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 2, Eigen::RowMajor>>(
                           mean.values.data() + 2 * k * waypoints, waypoints, 2)
                           .cast<double>());
  }
  if (regression_ != nullptr) {
    scale_ = Eigen::Map<const Eigen::VectorXf>(weights.at("anchors.scale").values.data(), waypoints)
                 .cast<double>();
  } else {
    covariance_ = Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
                      weights.at("anchors.covariance").values.data(), mean.shape[0] * waypoints, 3)
                      .cast<double>();
  }
}

absl::StatusOr<std::shared_ptr<const AnchorModel>> AnchorModel::Make(const v1::ModelSpec& spec,
                                                                     TensorMap weights,
                                                                     const EngineOptions& options) {
  artifact::StoredModel scenes;
  *scenes.manifest.mutable_spec() = spec;
  for (const auto& [name, tensor] : weights) {
    if (!absl::StartsWith(name, "anchor")) scenes.weights[name] = tensor;
  }
  absl::StatusOr<std::shared_ptr<const ActionModel>> model =
      ActionModel::FromStored(std::move(scenes), options);
  if (!model.ok()) return model.status();
  return std::shared_ptr<const AnchorModel>(new AnchorModel(*std::move(model), weights));
}

std::vector<ActionDistribution> AnchorModel::Describe(const SceneEncoding& encoding,
                                                      MlpScratch* scratch) const {
  const Eigen::Index waypoints = anchors_.front().rows();
  Eigen::VectorXf regressed;
  if (regression_ != nullptr) {
    regressed.resize(regression_->outputs());
    regression_->Apply(encoding.features.data(), 1, scratch, regressed.data());
  }
  std::vector<ActionDistribution> distributions(anchors_.size());
  for (size_t k = 0; k < anchors_.size(); ++k) {
    ActionDistribution& distribution = distributions[k];
    distribution.action = static_cast<int>(k);
    Trajectory mean = anchors_[k];
    if (encoding.reference.size() > 0) mean += encoding.reference;
    const Eigen::Index first = static_cast<Eigen::Index>(k) * waypoints;
    if (regression_ == nullptr) {
      distribution.moment_covariance = covariance_.middleRows(first, waypoints);
    } else {
      distribution.moment_covariance.resize(waypoints, 3);
      for (Eigen::Index t = 0; t < waypoints; ++t) {
        const Eigen::VectorXd numbers =
            regressed.segment<AnchorGaussian::kNumbers>(AnchorGaussian::kNumbers * (first + t))
                .cast<double>();
        const auto sigma = [](double log_sigma) {
          return AnchorGaussian::kSmallestSigma +
                 std::exp(std::min(log_sigma, AnchorGaussian::kLargestLogSigma));
        };
        mean.row(t) += numbers.head<2>().transpose();
        const double x = sigma(numbers[2]);
        const double y = sigma(numbers[3]);
        const double correlation = AnchorGaussian::kLargestCorrelation * std::tanh(numbers[4]);
        distribution.moment_covariance.row(t) =
            scale_[t] * Eigen::RowVector3d(x * x, correlation * x * y, y * y);
      }
    }
    distribution.moment_mean = mean;
    distribution.sigma = {std::move(mean)};
  }
  return distributions;
}

int AnchorModel::Nearest(const SceneEncoding& encoding, const Trajectory& trajectory) const {
  Trajectory departure = trajectory;
  if (encoding.reference.size() > 0) departure -= encoding.reference;
  int nearest = 0;
  double smallest = std::numeric_limits<double>::infinity();
  for (size_t k = 0; k < anchors_.size(); ++k) {
    const double distance = (anchors_[k] - departure).squaredNorm();
    if (distance < smallest) {
      smallest = distance;
      nearest = static_cast<int>(k);
    }
  }
  return nearest;
}

absl::StatusOr<AnchorBaselines> LoadAnchorBaselines(const std::filesystem::path& folder,
                                                    const EngineOptions& options) {
  absl::StatusOr<artifact::StoredBaselines> stored = artifact::ReadBaselines(folder);
  if (!stored.ok()) return stored.status();
  auto covernet = AnchorModel::Make(stored->spec, std::move(stored->covernet), options);
  if (!covernet.ok()) return covernet.status();
  auto multipath = AnchorModel::Make(stored->spec, std::move(stored->multipath), options);
  if (!multipath.ok()) return multipath.status();
  return AnchorBaselines{*std::move(covernet), *std::move(multipath)};
}

}  // namespace maneuver::inference
