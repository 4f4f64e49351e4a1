#include "model/inference/scene_network.h"

#include <algorithm>

#include "model/inference/stored_layers.h"

namespace maneuver::inference {

SceneNetwork::SceneNetwork(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16)
    : history_first_(StoredLayer(weights, "history.0", false)),
      history_second_(StoredLayer(weights, "history.1", false)),
      join_(StoredLayer(weights, "join", bf16)) {
  const v1::SceneVectorsSpec& vectors = spec.scene_vectors();
  if (vectors.path_width() == 0) return;
  paths_ = PathLayers{StoredLayer(weights, "lane_path.0", false),
                      StoredLayer(weights, "lane_path.1", false),
                      StoredLayer(weights, "lane_path.history", false),
                      StoredLayer(weights, "lane_path.output", false),
                      StoredLayer(weights, "lane_path.attention", false),
                      {vectors.path_width(), vectors.attention_heads()}};
}

size_t SceneNetwork::bytes() const {
  size_t bytes = history_first_.bytes() + history_second_.bytes() + join_.bytes();
  if (paths_) {
    bytes += paths_->first.bytes() + paths_->second.bytes() + paths_->history.bytes() +
             paths_->output.bytes() + paths_->attention.bytes();
  }
  return bytes;
}

void SceneNetwork::Evaluate(std::span<const scene::SceneVectors* const> scenes,
                            const float* raster_features, SceneVectorFeatures* output) const {
  EvaluateHistories(scenes, output);
  if (paths_) EvaluatePaths(scenes, output);
  const size_t own = static_cast<size_t>(history_second_.outputs());
  const size_t pooled = 2 * static_cast<size_t>(path_width());
  const size_t inputs = static_cast<size_t>(join_.inputs());
  const size_t raster = inputs - own - pooled;
  output->joined.resize(scenes.size() * inputs);
  for (size_t s = 0; s < scenes.size(); ++s) {
    float* row = output->joined.data() + s * inputs;
    std::copy_n(output->own.data() + s * own, own, row);
    if (paths_) {
      const int first = output->first_path[s];
      PoolSet(output->paths.data() + first * paths_->shape.width,
              output->scores.data() + first * paths_->shape.heads,
              output->first_path[s + 1] - first, paths_->shape, row + own);
    }
    if (raster > 0) std::copy_n(raster_features + s * raster, raster, row + own + pooled);
  }
  output->features.resize(scenes.size() * static_cast<size_t>(join_.outputs()));
  join_.Apply(output->joined.data(), static_cast<int>(scenes.size()), Activation::kRelu,
              &output->dense, output->features.data());
}

void SceneNetwork::EvaluateHistories(std::span<const scene::SceneVectors* const> scenes,
                                     SceneVectorFeatures* output) const {
  const int rows = static_cast<int>(scenes.size());
  output->histories.clear();
  for (const scene::SceneVectors* scene : scenes) {
    output->histories.insert(output->histories.end(), scene->history.begin(), scene->history.end());
  }
  const size_t width = static_cast<size_t>(history_second_.outputs());
  output->hidden.resize(scenes.size() * width);
  history_first_.Apply(output->histories.data(), rows, Activation::kRelu, &output->dense,
                       output->hidden.data());
  output->own.resize(scenes.size() * width);
  history_second_.Apply(output->hidden.data(), rows, Activation::kRelu, &output->dense,
                        output->own.data());
}

void SceneNetwork::EvaluatePaths(std::span<const scene::SceneVectors* const> scenes,
                                 SceneVectorFeatures* output) const {
  output->inputs.clear();
  output->first_path.assign(1, 0);
  for (const scene::SceneVectors* scene : scenes) {
    const float* values = scene->paths.values.data();
    output->inputs.insert(output->inputs.end(), values,
                          values + scene->paths.count * scene::kLanePathInputs);
    output->first_path.push_back(output->first_path.back() + scene->paths.count);
  }
  const int rows = output->first_path.back();
  const int width = paths_->shape.width;
  const size_t size = static_cast<size_t>(rows) * static_cast<size_t>(width);
  output->hidden.resize(size);
  output->alone.resize(size);
  output->paths.resize(size);
  output->own_terms.resize(scenes.size() * static_cast<size_t>(width));
  output->scores.resize(static_cast<size_t>(rows) * static_cast<size_t>(paths_->shape.heads));
  paths_->first.Apply(output->inputs.data(), rows, Activation::kRelu, &output->dense,
                      output->hidden.data());
  paths_->second.Apply(output->hidden.data(), rows, Activation::kNone, &output->dense,
                       output->alone.data());
  paths_->history.Apply(output->own.data(), static_cast<int>(scenes.size()), Activation::kNone,
                        &output->dense, output->own_terms.data());
  for (size_t s = 0; s < scenes.size(); ++s) {
    const Eigen::Map<const Eigen::ArrayXf> term(
        output->own_terms.data() + static_cast<Eigen::Index>(s) * width, width);
    for (int i = output->first_path[s]; i < output->first_path[s + 1]; ++i) {
      Eigen::Map<Eigen::ArrayXf> path(output->alone.data() + Eigen::Index{i} * width, width);
      path = (path + term).max(0.0f);
    }
  }
  paths_->output.Apply(output->alone.data(), rows, Activation::kRelu, &output->dense,
                       output->paths.data());
  paths_->attention.Apply(output->paths.data(), rows, Activation::kNone, &output->dense,
                          output->scores.data());
}

}  // namespace maneuver::inference
