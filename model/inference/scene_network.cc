#include "model/inference/scene_network.h"

#include <Eigen/Core>
#include <algorithm>

#include "model/artifact/model_spec.h"
#include "model/inference/stored_layers.h"

namespace maneuver::inference {
namespace {

// Appends what is pooled of the elements of scene s of a batch. Returns the end of it.
float* AppendPooled(const SetFeatures& set, SetShape shape, size_t s, float* row) {
  const int first = set.first[s];
  kernels::PoolSet(set.elements.data() + Eigen::Index{first} * shape.width,
                   set.scores.data() + Eigen::Index{first} * shape.heads, set.first[s + 1] - first,
                   shape, row);
  return row + Eigen::Index{2} * shape.width;
}

}  // namespace

SceneNetwork::SceneNetwork(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16)
    : history_first_(StoredLayer(weights, "history.0", false)),
      history_second_(StoredLayer(weights, "history.1", false)),
      join_(StoredLayer(weights, "join", bf16)) {
  const v1::SceneVectorsSpec& vectors = spec.scene_vectors();
  if (artifact::ReadsLanePaths(spec)) {
    paths_.emplace(weights, "lane_path", SetShape{vectors.path_width(), vectors.attention_heads()});
  }
  if (artifact::ReadsAgents(spec)) {
    agents_.emplace(weights, "agent", SetShape{vectors.agent_width(), vectors.agent_heads()});
  }
}

SceneNetwork::SetLayers::SetLayers(const artifact::TensorMap& weights, const std::string& name,
                                   SetShape set_shape)
    : first(StoredLayer(weights, name + ".0", false)),
      second(StoredLayer(weights, name + ".1", false)),
      history(StoredLayer(weights, name + ".history", false)),
      output(StoredLayer(weights, name + ".output", false)),
      attention(StoredLayer(weights, name + ".attention", false)),
      shape(set_shape) {}

size_t SceneNetwork::SetLayers::bytes() const {
  return first.bytes() + second.bytes() + history.bytes() + output.bytes() + attention.bytes();
}

size_t SceneNetwork::bytes() const {
  return history_first_.bytes() + history_second_.bytes() + join_.bytes() +
         (paths_ ? paths_->bytes() : 0) + (agents_ ? agents_->bytes() : 0);
}

void SceneNetwork::Evaluate(std::span<const scene::SceneVectors* const> scenes,
                            const float* raster_features, SceneVectorFeatures* output) const {
  EvaluateHistories(scenes, output);
  if (paths_) EvaluateSet(*paths_, scenes, &scene::SceneVectors::paths, output, &output->paths);
  if (agents_) EvaluateSet(*agents_, scenes, &scene::SceneVectors::agents, output, &output->agents);
  const size_t inputs = static_cast<size_t>(join_.inputs());
  output->joined.resize(scenes.size() * inputs);
  for (size_t s = 0; s < scenes.size(); ++s) {
    JoinParts(*output, s, raster_features, output->joined.data() + s * inputs);
  }
  output->features.resize(scenes.size() * static_cast<size_t>(join_.outputs()));
  join_.Apply(output->joined.data(), static_cast<int>(scenes.size()), Activation::kRelu,
              &output->dense, output->features.data());
}

void SceneNetwork::JoinParts(const SceneVectorFeatures& parts, size_t s,
                             const float* raster_features, float* row) const {
  const float* const end = row + join_.inputs();
  const size_t own = static_cast<size_t>(history_second_.outputs());
  row = std::copy_n(parts.own.data() + s * own, own, row);
  if (paths_) row = AppendPooled(parts.paths, paths_->shape, s, row);
  if (agents_) row = AppendPooled(parts.agents, agents_->shape, s, row);
  const size_t raster = static_cast<size_t>(end - row);
  if (raster > 0) std::copy_n(raster_features + s * raster, raster, row);
}

void SceneNetwork::EvaluateHistories(std::span<const scene::SceneVectors* const> scenes,
                                     SceneVectorFeatures* output) const {
  output->histories.clear();
  for (const scene::SceneVectors* scene : scenes) {
    output->histories.insert(output->histories.end(), scene->history.begin(), scene->history.end());
  }
  const int rows = static_cast<int>(scenes.size());
  const size_t size = scenes.size() * static_cast<size_t>(history_second_.outputs());
  output->joined.resize(size);
  output->own.resize(size);
  history_first_.Apply(output->histories.data(), rows, Activation::kRelu, &output->dense,
                       output->joined.data());
  history_second_.Apply(output->joined.data(), rows, Activation::kRelu, &output->dense,
                        output->own.data());
}

template <typename Inputs>
void SceneNetwork::EvaluateSet(const SetLayers& layers,
                               std::span<const scene::SceneVectors* const> scenes,
                               Inputs scene::SceneVectors::*inputs, SceneVectorFeatures* output,
                               SetFeatures* set) {
  set->numbers.clear();
  set->first.assign(1, 0);
  for (const scene::SceneVectors* scene : scenes) {
    const Inputs& elements = scene->*inputs;
    set->numbers.insert(set->numbers.end(), elements.values.begin(),
                        elements.values.begin() + elements.count * layers.first.inputs());
    set->first.push_back(set->first.back() + elements.count);
  }
  EvaluateElements(layers, output->own, &output->dense, set);
}

void SceneNetwork::EvaluateElements(const SetLayers& layers, const std::vector<float>& own,
                                    DenseScratch* dense, SetFeatures* set) {
  const size_t scenes = set->first.size() - 1;
  const int rows = set->first.back();
  const int width = layers.shape.width;
  const size_t size = static_cast<size_t>(rows) * static_cast<size_t>(width);
  set->hidden.resize(size);
  set->alone.resize(size);
  set->elements.resize(size);
  set->own_terms.resize(scenes * static_cast<size_t>(width));
  set->scores.resize(static_cast<size_t>(rows) * static_cast<size_t>(layers.shape.heads));
  layers.first.Apply(set->numbers.data(), rows, Activation::kRelu, dense, set->hidden.data());
  layers.second.Apply(set->hidden.data(), rows, Activation::kNone, dense, set->alone.data());
  layers.history.Apply(own.data(), static_cast<int>(scenes), Activation::kNone, dense,
                       set->own_terms.data());
  for (size_t s = 0; s < scenes; ++s) {
    const Eigen::Map<const Eigen::ArrayXf> term(
        set->own_terms.data() + static_cast<Eigen::Index>(s) * width, width);
    for (int i = set->first[s]; i < set->first[s + 1]; ++i) {
      Eigen::Map<Eigen::ArrayXf> element(set->alone.data() + Eigen::Index{i} * width, width);
      element = (element + term).max(0.0f);
    }
  }
  layers.output.Apply(set->alone.data(), rows, Activation::kRelu, dense, set->elements.data());
  layers.attention.Apply(set->elements.data(), rows, Activation::kNone, dense, set->scores.data());
}

}  // namespace maneuver::inference
