#include "model/learning/predictions.h"

#include <optional>
#include <vector>

#include "model/learning/moments.h"
#include "model/learning/scene_bound.h"
#include "model/learning/scene_covariance.h"
#include "model/learning/scene_loader.h"
#include "model/learning/validation.h"

namespace maneuver::learning {

ExampleFeatures EncodeExamples(Networks& networks, const SceneSource& source, int64_t most,
                               int threads, const std::function<bool()>& stopped,
                               const CountCalibrationStep& count) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> trajectories, features, geometry, references, speeds;
  SceneLoader loader(networks.spec(), source, DrawItems(source.set(), most), kEncodedBatch,
                     threads);
  while (std::optional<SceneLoader::Batch> batch = loader.Next()) {
    if (stopped()) break;
    const SceneFeatures scenes = networks.EncodeScenes(batch->scenes, {});
    trajectories.push_back(batch->trajectories.to(networks.device()));
    features.push_back(scenes.features);
    if (scenes.geometry.defined()) geometry.push_back(scenes.geometry);
    references.push_back(batch->scenes.references.to(networks.device()));
    speeds.push_back(batch->scenes.speeds.to(networks.device()));
    if (count) count(CalibrationStep::kEncode, scenes.size());
  }
  if (features.empty()) return {};
  return {at::cat(trajectories),
          {at::cat(features), geometry.empty() ? at::Tensor() : at::cat(geometry)},
          at::cat(references),
          at::cat(speeds),
          count};
}

Predictions Predictions::Rows(const at::Tensor& rows) const {
  const auto take = [&rows](const at::Tensor& all) {
    return all.defined() ? all.index_select(0, rows) : all;
  };
  return {take(trajectories),
          take(log_probabilities),
          take(log_responsibilities),
          take(mean),
          take(covariance),
          take(latents),
          take(speeds),
          take(along),
          take(across),
          count};
}

void Predictions::CountStep(CalibrationStep kind) const {
  if (count) count(kind, trajectories.size(0));
}

Predictions Predict(const Networks& networks, const ExampleFeatures& examples) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> log_p, log_q, means, covariances, latents, along, across;
  const int64_t count = examples.scenes.size();
  for (int64_t begin = 0; begin < count; begin += kPredictedBatch) {
    const at::Tensor x = examples.trajectories.slice(0, begin, begin + kPredictedBatch);
    const SceneFeatures scenes = examples.scenes.Slice(begin, begin + kPredictedBatch);
    const at::Tensor log_p_y = networks.PredictActions(scenes);
    const Gaussian posterior = networks.EncodeScenarios(scenes);
    const WaypointMoments moments =
        LatentMoments(networks, posterior, networks.MeanResidual(scenes));
    log_p.push_back(log_p_y);
    log_q.push_back(LogResponsibilities(networks, {x, scenes, {}}, log_p_y, posterior));
    means.push_back(moments.mean);
    covariances.push_back(moments.covariance);
    latents.push_back(posterior.mean);
    if (networks.spec().has_scene_covariance()) {
      const at::Tensor reference = examples.references.slice(0, begin, begin + kPredictedBatch);
      const SplitCovariance split =
          PredictSceneCovariance(networks, scenes, moments.mean, reference);
      along.push_back(split.along);
      across.push_back(split.across);
    }
    if (examples.count) examples.count(CalibrationStep::kPredict, x.size(0));
  }
  const auto join = [](const std::vector<at::Tensor>& parts) {
    return parts.empty() ? at::Tensor() : at::cat(parts);
  };
  return {examples.trajectories, join(log_p),     join(log_q), join(means),  join(covariances),
          join(latents),         examples.speeds, join(along), join(across), examples.count};
}

at::Tensor PredictLogProbabilities(const Networks& networks, const ExampleFeatures& examples) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> log_p;
  const int64_t count = examples.scenes.size();
  for (int64_t begin = 0; begin < count; begin += kPredictedBatch) {
    log_p.push_back(networks.PredictActions(examples.scenes.Slice(begin, begin + kPredictedBatch)));
  }
  return log_p.empty() ? at::Tensor() : at::cat(log_p);
}

}  // namespace maneuver::learning
