// The features of a scene that is read as vectors: the target's own history and the lane paths,
// joined with the raster's features where there is a raster.

#ifndef MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_
#define MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/dense_layer.h"
#include "model/inference/set_pooling.h"
#include "model/scene/scene_vectors.h"

namespace maneuver::inference {

// What SceneNetwork answers for a batch; also its scratch. One for each thread.
struct SceneVectorFeatures {
  std::vector<float> features;  // [scenes, F]
  // l_i of all lane paths of the batch, [paths, P]: those of scene s begin at first_path[s].
  std::vector<float> paths;
  std::vector<int> first_path;  // [scenes + 1]

  // Scratch.
  DenseScratch dense;
  std::vector<float> histories, own, own_terms, inputs, hidden, alone, scores, joined;
};

// tensor.h's history, lane_path and join. Immutable; safe to share between threads.
class SceneNetwork {
 public:
  // bf16: of the weights of join alone, the widest layer.
  SceneNetwork(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16);

  int features() const { return join_.outputs(); }
  // P; 0 for a model that reads no lane paths.
  int path_width() const { return paths_ ? paths_->shape.width : 0; }
  size_t bytes() const;

  // Writes f and l_i of each scene. A scene's numbers are the same bits whatever the batch.
  //   raster_features: [scenes, join's inputs that are neither]; null of a model without a raster
  void Evaluate(std::span<const scene::SceneVectors* const> scenes, const float* raster_features,
                SceneVectorFeatures* output) const;

 private:
  struct PathLayers {
    DenseLayer first;      // 84 -> P
    DenseLayer second;     // P -> P
    DenseLayer history;    // H -> P
    DenseLayer output;     // P -> P
    DenseLayer attention;  // P -> heads
    SetShape shape;
  };

  void EvaluateHistories(std::span<const scene::SceneVectors* const> scenes,
                         SceneVectorFeatures* output) const;
  // l_i and the attention's scores.
  void EvaluatePaths(std::span<const scene::SceneVectors* const> scenes,
                     SceneVectorFeatures* output) const;

  DenseLayer history_first_;   // 42 -> H
  DenseLayer history_second_;  // H -> H
  std::optional<PathLayers> paths_;
  DenseLayer join_;  // H + 2P + raster's features -> F
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_
