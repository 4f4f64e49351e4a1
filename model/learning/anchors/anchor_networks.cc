#include "model/learning/anchors/anchor_networks.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_spec.h"
#include "model/learning/moments.h"
#include "model/learning/trajectory_clusters.h"

namespace maneuver::learning {
namespace {

using artifact::AnchorGaussian;

constexpr int64_t kMostForAnchors = 16'384;       // examples
constexpr int kRestarts = 3;                      // of k-means
constexpr double kSmallestAnchorDeviation = 0.3;  // metres
constexpr double kSmallAtFirst = 0.05;  // of the usual deviation: a last layer starts small
constexpr char kCovariance[] = "anchors.covariance";
constexpr char kScale[] = "anchors.scale";

std::string PredictorLayer(int i, const char* tensor) {
  return "anchor_regression." + std::to_string(i) + "." + tensor;
}

artifact::Tensor Copy(const at::Tensor& tensor) {
  const at::Tensor values = tensor.detach().to(at::kCPU, at::kFloat).contiguous();
  return {values.sizes().vec(),
          {values.data_ptr<float>(), values.data_ptr<float>() + values.numel()}};
}

// [B, K, T, n] -> [B, 1, T, n] of each example's own anchor.
at::Tensor OfAnchor(const at::Tensor& values, const at::Tensor& nearest) {
  return values.gather(1,
                       nearest.view({-1, 1, 1, 1}).expand({-1, 1, values.size(2), values.size(3)}));
}

}  // namespace

Anchors PlaceAnchors(const at::Tensor& trajectories, int anchors, bool mirrored, uint64_t seed) {
  const int64_t count = std::min(trajectories.size(0), kMostForAnchors);
  at::Tensor rows = trajectories.index_select(
      0, at::arange(count, at::kLong).mul_(trajectories.size(0)).floor_divide_(count));
  if (mirrored) {
    at::Tensor mirror = rows.clone();
    mirror.view({count, -1, 2}).select(2, 1).neg_();
    rows = at::cat({rows, mirror});
  }
  rows = rows.contiguous();
  const TrajectoryClusters clusters = ClusterTrajectories(
      Eigen::Map<const TrajectoryRows>(rows.data_ptr<float>(), rows.size(0), rows.size(1)), anchors,
      seed, kRestarts);
  const at::Tensor mean =
      at::from_blob(const_cast<float*>(clusters.centers.data()), {anchors, rows.size(1)}).clone();
  const at::Tensor assigned = NearestAnchor(mean.view({anchors, -1, 2}), rows);
  const at::Tensor squares = (rows - mean.index_select(0, assigned)).square();
  const at::Tensor sums = at::zeros_like(mean).index_add(0, assigned, squares);
  const at::Tensor counts = at::bincount(assigned, {}, anchors).clamp_min(1).unsqueeze(1);
  return {mean.view({anchors, -1, 2}),
          (sums / counts).sqrt().clamp_min(kSmallestAnchorDeviation).view({anchors, -1, 2})};
}

at::Tensor NearestAnchor(const at::Tensor& anchors, const at::Tensor& trajectories) {
  std::vector<at::Tensor> distances;
  for (int64_t k = 0; k < anchors.size(0); ++k) {
    distances.push_back((trajectories - anchors[k].flatten()).square().mean(1));
  }
  return at::stack(distances, 1).argmin(1);
}

at::Tensor ClassifierLoss(const AnchorPredictions& predictions, const at::Tensor& nearest) {
  return -predictions.log_probabilities.gather(1, nearest.unsqueeze(1)).squeeze(1);
}

at::Tensor MultiPathLoss(const AnchorPredictions& predictions, const at::Tensor& nearest,
                         const at::Tensor& trajectories) {
  const at::Tensor log_densities =
      WaypointLogDensities(OfAnchor(predictions.mean, nearest),
                           OfAnchor(predictions.covariance, nearest), trajectories)
          .squeeze(1);  // [B, T]
  return ClassifierLoss(predictions, nearest) - log_densities.sum(1);
}

at::Tensor AnchorCovariance(const at::Tensor& numbers) {
  const at::Tensor sigma =
      AnchorGaussian::kSmallestSigma +
      numbers.slice(-1, 0, 2).clamp_max(AnchorGaussian::kLargestLogSigma).exp();
  const at::Tensor x = sigma.select(-1, 0);
  const at::Tensor y = sigma.select(-1, 1);
  const at::Tensor correlation = AnchorGaussian::kLargestCorrelation * numbers.select(-1, 2).tanh();
  return at::stack({x.square(), correlation * x * y, y.square()}, -1);
}

AnchorNetworks::AnchorNetworks(const v1::ModelSpec& model, Anchors anchors, bool regresses,
                               at::Device device, at::Generator& generator)
    : scenes_(artifact::AnchorSpec(model), device, generator),
      regresses_(regresses),
      anchors_(anchors.mean.to(device)),
      deviation_(anchors.deviation.to(device)) {
  const int64_t waypoints = anchors_.size(1);
  if (!regresses_) {
    const at::Tensor variance = deviation_.square();
    tensors_[kCovariance] = at::stack(
        {variance.select(2, 0), at::zeros_like(variance.select(2, 0)), variance.select(2, 1)}, 2);
    return;
  }
  tensors_[kScale] = at::ones({waypoints}, anchors_.options());
  const v1::MlpSpec& hidden = model.action_predictor();
  int64_t inputs =
      scenes_["action_predictor.0.weight"].size(1);  // features, and motion where it is read
  for (int i = 0; i <= hidden.hidden_size(); ++i) {
    const bool last = i == hidden.hidden_size();
    const int64_t outputs =
        last ? anchors_.size(0) * waypoints * AnchorGaussian::kNumbers : hidden.hidden(i);
    const double stddev =
        (last ? kSmallAtFirst : 1.0) * std::sqrt(2.0 / static_cast<double>(inputs));
    tensors_[PredictorLayer(i, "weight")] = at::empty({outputs, inputs}, at::kFloat)
                                                .normal_(0.0, stddev, generator)
                                                .to(device)
                                                .set_requires_grad(true);
    tensors_[PredictorLayer(i, "bias")] =
        at::zeros({outputs}, anchors_.options()).set_requires_grad(true);
    inputs = outputs;
  }
}

AnchorPredictions AnchorNetworks::Predict(const SceneTensors& scenes, const Networks::Mode& mode) {
  const SceneFeatures encoded = scenes_.EncodeScenes(scenes, mode);
  AnchorPredictions predictions;
  predictions.log_probabilities = scenes_.PredictActions(encoded);
  const int64_t batch = encoded.size();
  if (!regresses_) {
    predictions.mean = anchors_.unsqueeze(0).expand({batch, -1, -1, -1});
    predictions.covariance = tensors_.at(kCovariance).unsqueeze(0).expand({batch, -1, -1, -1});
    return predictions;
  }
  at::Tensor numbers = encoded.features;
  for (int i = 0; i <= spec().action_predictor().hidden_size(); ++i) {
    if (i > 0) numbers = numbers.relu();
    numbers = at::linear(numbers, tensors_.at(PredictorLayer(i, "weight")),
                         tensors_.at(PredictorLayer(i, "bias")));
  }
  numbers = numbers.view({batch, anchors_.size(0), anchors_.size(1), AnchorGaussian::kNumbers});
  predictions.mean = anchors_ + deviation_ * numbers.slice(3, 0, 2);
  const at::Tensor shape =
      at::cat({numbers.slice(3, 2, 4) + deviation_.log(), numbers.slice(3, 4)}, 3);
  predictions.covariance = AnchorCovariance(shape) * tensors_.at(kScale).view({-1, 1});
  return predictions;
}

std::vector<at::Tensor> AnchorNetworks::Parameters() const {
  std::vector<at::Tensor> parameters = scenes_.Parameters(Networks::Part::kScene);
  for (const at::Tensor& each : scenes_.Parameters(Networks::Part::kActions)) {
    parameters.push_back(each);
  }
  for (const auto& [name, tensor] : tensors_) {
    if (tensor.requires_grad()) parameters.push_back(tensor);
  }
  return parameters;
}

void AnchorNetworks::SetTemperature(double temperature) {
  at::NoGradGuard no_grad;
  const std::string last = artifact::LastLayer("action_predictor", spec().action_predictor());
  scenes_[last + ".weight"].div_(temperature);
  scenes_[last + ".bias"].div_(temperature);
}

void AnchorNetworks::SetCovariance(const at::Tensor& covariance) {
  tensors_.at(kCovariance).copy_(covariance);
}

void AnchorNetworks::SetScale(const at::Tensor& scale) { tensors_.at(kScale).copy_(scale); }

artifact::TensorMap AnchorNetworks::Export() const {
  at::NoGradGuard no_grad;
  artifact::TensorMap weights = scenes_.Export();
  weights["anchors.mean"] = Copy(anchors_);
  for (const auto& [name, tensor] : tensors_) weights[name] = Copy(tensor);
  if (!regresses_) return weights;
  // The folder's regression yields metres: what it is relative to goes into the last layer.
  const int last = spec().action_predictor().hidden_size();
  const at::Tensor ones = at::ones_like(deviation_);
  const at::Tensor factor = at::cat({deviation_, ones, ones.slice(2, 0, 1)}, 2).flatten();
  const at::Tensor offset =
      at::cat({at::zeros_like(ones), deviation_.log(), at::zeros_like(ones.slice(2, 0, 1))}, 2)
          .flatten();
  weights[PredictorLayer(last, "weight")] =
      Copy(tensors_.at(PredictorLayer(last, "weight")) * factor.unsqueeze(1));
  weights[PredictorLayer(last, "bias")] =
      Copy(tensors_.at(PredictorLayer(last, "bias")) * factor + offset);
  return weights;
}

Networks::Snapshot AnchorNetworks::Save() const {
  Networks::Snapshot snapshot = scenes_.Save();
  for (const auto& [name, tensor] : tensors_) snapshot[name] = tensor.detach().clone();
  return snapshot;
}

void AnchorNetworks::Restore(const Networks::Snapshot& snapshot) {
  at::NoGradGuard no_grad;
  scenes_.Restore(snapshot);
  for (auto& [name, tensor] : tensors_) tensor.copy_(snapshot.at(name));
}

}  // namespace maneuver::learning
