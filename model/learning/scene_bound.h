// The bound of a batch of examples under each objective.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
#define MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_

#include <functional>

#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// What the networks see of a batch.
struct SceneBatch {
  at::Tensor trajectories;  // x - r(m), [B, 2T] metres
  SceneFeatures scenes;     // undefined features: p(y) knows no scene
  at::Tensor labels;        // [B] as in BaseModel, or undefined
};

// Standard normal noise of a shape; zeros take means for samples.
using NoiseSource = std::function<at::Tensor(at::IntArrayRef shape)>;

// The base model's part of a batch: q(z|x), a sample's decoding, p(z|y), p(y|s).
BaseModel ApplyBase(const Networks& networks, const SceneBatch& batch, const NoiseSource& noise);

// What learns from a bound.
enum class Learning {
  kAll,        // everything in it
  kPosterior,  // q(z|y,s) alone; all else is held fixed
};

// The bound that `objective` maximises; that of DUAL is the last stage of the dual model, for
// kPosterior.
BoundTerms SceneBound(const Networks& networks, v1::Objective objective, Learning learning,
                      const v1::OptimizationSettings& optimization, const SceneBatch& batch,
                      const NoiseSource& noise);

// ln q(y|x,s) as the engine answers it: that of the base model unless the model is a unified one.
// [B, K]
at::Tensor Responsibilities(const Networks& networks, const SceneBatch& batch,
                            const at::Tensor& log_p_y, const Gaussian& posterior);

//   share: of the weights of the divergences, where they are warmed up
BoundWeights Weights(const v1::OptimizationSettings& optimization, double share = 1.0);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
