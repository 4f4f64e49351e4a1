// Computes the features of a scene that is read as vectors: the target's own history, the lane
// paths and the agents nearby, joined with the raster's features if there is a raster.

#ifndef MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_
#define MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"
#include "model/kernels/set_pooling.h"
#include "model/scene/scene_vectors.h"

namespace maneuver::inference {

using kernels::SetShape;

// The outputs for the elements of one kind of set (lane paths or agents), for all scenes of a
// batch, one scene after the other.
struct SetFeatures {
  std::vector<float> elements;  // [elements, width]
  std::vector<int> first;       // [scenes + 1] where the elements of each scene begin

  // Scratch.
  std::vector<float> numbers, hidden, alone, own_terms, scores;
};

// The outputs of SceneNetwork for a batch, and its scratch memory. Each thread needs its own.
struct SceneVectorFeatures {
  std::vector<float> features;  // [scenes, F]
  SetFeatures paths;            // l_i of the lane paths
  SetFeatures agents;

  // Scratch.
  DenseScratch dense;
  std::vector<float> histories, own, joined;
};

// Evaluates the networks that tensor.h calls history, lane_path, agent and join. Immutable; safe to
// share between threads.
class SceneNetwork {
 public:
  // Prepares the networks.
  //   bf16: the precision of the weights of join, the widest layer; the other layers are f32
  SceneNetwork(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16);

  int features() const { return join_.outputs(); }
  size_t bytes() const;

  // Writes f, l_i and the elements of agents for each scene. A scene's numbers have the same bits
  // whatever the batch.
  //   raster_features: [scenes, n], the other inputs of join; null for a model without a raster
  void Evaluate(std::span<const scene::SceneVectors* const> scenes, const float* raster_features,
                SceneVectorFeatures* output) const;

 private:
  // The layers for a set whose elements have n numbers each and W channels.
  struct SetLayers {
    SetLayers(const artifact::TensorMap& weights, const std::string& name, SetShape set_shape);
    size_t bytes() const;

    DenseLayer first;      // n -> W
    DenseLayer second;     // W -> W
    DenseLayer history;    // H -> W
    DenseLayer output;     // W -> W
    DenseLayer attention;  // W -> heads
    SetShape shape;
  };

  void EvaluateHistories(std::span<const scene::SceneVectors* const> scenes,
                         SceneVectorFeatures* output) const;
  // Evaluates the elements and the attention's scores of a set.
  //   inputs: scene::SceneVectors's member that has the numbers of the set
  template <typename Inputs>
  static void EvaluateSet(const SetLayers& layers,
                          std::span<const scene::SceneVectors* const> scenes,
                          Inputs scene::SceneVectors::*inputs, SceneVectorFeatures* output,
                          SetFeatures* set);
  // Evaluates the sets whose numbers and first elements are in `set`.
  //   own: [scenes, H]
  static void EvaluateElements(const SetLayers& layers, const std::vector<float>& own,
                               DenseScratch* dense, SetFeatures* set);
  // Writes what join reads of scene s of a batch.
  void JoinParts(const SceneVectorFeatures& parts, size_t s, const float* raster_features,
                 float* row) const;

  DenseLayer history_first_;   // 42 -> H
  DenseLayer history_second_;  // H -> H
  std::optional<SetLayers> paths_;
  std::optional<SetLayers> agents_;
  DenseLayer join_;  // H + 2P + 2Q + raster's features -> F
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SCENE_NETWORK_H_
