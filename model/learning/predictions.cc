#include "model/learning/predictions.h"

#include <optional>
#include <vector>

#include "model/learning/moments.h"
#include "model/learning/raster_loader.h"
#include "model/learning/scene_bound.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

constexpr int64_t kEncodedBatch = 64;
constexpr int64_t kPredictedBatch = 32;

}  // namespace

ExampleFeatures EncodeExamples(Networks& networks, const ExampleSet& set, int64_t most, int threads,
                               const std::function<bool()>& stopped,
                               const std::function<void(int64_t)>& step) {
  at::NoGradGuard no_grad;
  const v1::RasterSpec& raster = networks.spec().raster();
  std::vector<at::Tensor> trajectories, features;
  RasterLoader loader(raster, set, DrawItems(set, most), kEncodedBatch, threads);
  while (std::optional<RasterLoader::Batch> batch = loader.Next()) {
    if (stopped()) break;
    trajectories.push_back(VariedTrajectories(set, *batch).to(networks.device()));
    features.push_back(
        networks.EncodeScenes(RasterTensor(raster, *batch), VariedMotions(set, *batch), {}));
    step(features.back().size(0));
  }
  if (features.empty()) return {};
  return {at::cat(trajectories), at::cat(features)};
}

Predictions Predictions::Rows(const at::Tensor& rows) const {
  return {trajectories.index_select(0, rows),
          log_probabilities.index_select(0, rows),
          log_responsibilities.index_select(0, rows),
          mean.index_select(0, rows),
          covariance.index_select(0, rows),
          latents.defined() ? latents.index_select(0, rows) : at::Tensor()};
}

Predictions Predict(const Networks& networks, const ExampleFeatures& examples) {
  at::NoGradGuard no_grad;
  std::vector<at::Tensor> log_p, log_q, means, covariances, latents;
  const int64_t count = examples.features.size(0);
  for (int64_t begin = 0; begin < count; begin += kPredictedBatch) {
    const at::Tensor x = examples.trajectories.slice(0, begin, begin + kPredictedBatch);
    const at::Tensor features = examples.features.slice(0, begin, begin + kPredictedBatch);
    const at::Tensor log_p_y = networks.PredictActions(features);
    const Gaussian posterior = networks.EncodeScenarios(features);
    const WaypointMoments moments = LatentMoments(networks, posterior);
    log_p.push_back(log_p_y);
    log_q.push_back(Responsibilities(networks, {x, features, {}}, log_p_y, posterior));
    means.push_back(moments.mean);
    covariances.push_back(moments.covariance);
    latents.push_back(posterior.mean);
  }
  return {examples.trajectories, at::cat(log_p),       at::cat(log_q),
          at::cat(means),        at::cat(covariances), at::cat(latents)};
}

}  // namespace maneuver::learning
