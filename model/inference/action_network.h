// Compares actions with lanes: the generic trajectory of each action is described relative to each
// lane path, and the result feeds p(y|s), q(z|y,s) and the mean of the action.

#ifndef MANEUVER_MODEL_INFERENCE_ACTION_NETWORK_H_
#define MANEUVER_MODEL_INFERENCE_ACTION_NETWORK_H_

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"
#include "model/inference/scene_network.h"
#include "model/inference/trajectory_set.h"
#include "model/kernels/set_pooling.h"
#include "model/scene/action_geometry.h"
#include "model/scene/scene_vectors.h"

namespace maneuver::inference {

// The outputs of ActionNetwork for a batch, and its scratch memory. Each thread needs its own.
struct ActionFeatures {
  std::vector<float> geometry;  // [scenes, K, A] h_y
  std::vector<float> logits;    // [scenes, K] what h_y adds to the logit of action y

  // Scratch.
  DenseScratch dense;
  std::vector<scene::ActionPoints> points;
  std::vector<float> scene_terms, path_terms, all_pairs, actions;
  std::vector<float> pairs, first, second, scores, joined, joint;
  Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> action_terms;  // [K, G]
};

// Evaluates the networks that tensor.h calls action_geometry. Computes in f32 whatever the
// precision of the other layers, because the result decides logits. Immutable; safe to share
// between threads.
class ActionNetwork {
 public:
  // Prepares the networks.
  //   generic: [K, 2T] metres, the decoded means of p(z|y), without a reference
  ActionNetwork(const v1::ModelSpec& spec, const artifact::TensorMap& weights,
                const TrajectorySet::Rows& generic);

  int features() const { return output_.outputs(); }  // A
  size_t bytes() const;

  // Writes h_y and the logits of each scene. A scene's numbers are the same bits whatever the
  // batch.
  //   references: r(m) of each scene, target frame; empty without a reference
  //   inputs: the outputs of SceneNetwork for these scenes
  void Evaluate(std::span<const scene::SceneVectors* const> scenes,
                std::span<const Trajectory* const> references, const SceneVectorFeatures& inputs,
                ActionFeatures* output) const;

  // Adds the contribution of h_k to the outputs of scenario encoder k.
  //   geometry: [A] h_k;  outputs: [2D] a, then b
  void AddLatent(int k, const float* geometry, DenseScratch* scratch,
                 Eigen::VectorXf* outputs) const;

 private:
  // Writes h_y of one scene into `geometry`, [K, A].
  //   scene_terms: [G + A];  path_terms: [paths, G]
  void EvaluateScene(const scene::SceneVectors& scene, const Trajectory& reference,
                     const float* scene_terms, const float* path_terms, ActionFeatures* scratch,
                     float* geometry) const;
  // Returns the points of each action's generic trajectory, the reference included.
  void PlaceActions(const Trajectory& reference, std::vector<scene::ActionPoints>* points) const;
  // Computes g_yi for all actions and for the paths of the scene, [K, paths, G].
  void EvaluatePairs(int paths, const float* scene_terms, const float* path_terms,
                     ActionFeatures* scratch) const;

  using RowMajorXf = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  scene::GeometryWaypoints waypoints_;
  int inputs_version_;
  std::vector<scene::ActionPoints> generic_;  // [K] without a reference
  SetShape shape_;                            // of g_yi
  DenseLayer pair_;                           // 18 -> G
  DenseLayer path_;                           // P -> G
  DenseLayer scene_;                          // F -> G + A: scene's, then joint_scene's
  RowMajorXf action_bias_;                    // [K, G]
  DenseLayer hidden_;                         // G -> G
  DenseLayer attention_;                      // G -> heads
  DenseLayer joint_;                          // 2G + 13 -> A
  RowMajorXf joint_bias_;                     // [K, A]
  DenseLayer output_;                         // A -> A
  DenseLayer logit_;                          // A -> 1
  std::vector<DenseLayer> latent_;            // [K] A -> 2D
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_ACTION_NETWORK_H_
