// The bound of a batch of examples under each objective.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
#define MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_

#include <ATen/ATen.h>

#include <functional>

#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"

namespace maneuver::learning {

// What the networks see of a batch.
struct SceneBatch {
  at::Tensor trajectories;  // x, [B, 2T] metres
  at::Tensor features;      // of the backbone, [B, F]
  at::Tensor labels;        // [B] as in BaseModel, or undefined
};

// Standard normal noise of a shape; zeros take means for samples.
using NoiseSource = std::function<at::Tensor(at::IntArrayRef shape)>;

// The base model's part of a batch: q(z|x), a sample's decoding, p(z|y), p(y|s).
BaseModel ApplyBase(const Networks& networks, const SceneBatch& batch, const NoiseSource& noise);

// The bound that `objective` maximises, or in its last stage: DUAL has the part of q(z|y,s) alone,
// with everything else held fixed.
BoundTerms SceneBound(const Networks& networks, v1::Objective objective,
                      const v1::OptimizationSettings& optimization, const SceneBatch& batch,
                      const NoiseSource& noise);

// ln q(y|x,s) as the engine answers it: that of the base model unless the model is a unified one.
// [B, K]
at::Tensor Responsibilities(const Networks& networks, const SceneBatch& batch,
                            const at::Tensor& log_p_y, const Gaussian& posterior);

BoundWeights Weights(const v1::OptimizationSettings& optimization);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
