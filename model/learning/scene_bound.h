// Computes the bound of a batch of examples under each objective.

#ifndef MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
#define MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_

#include <functional>

#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// What the networks read of a batch.
struct SceneBatch {
  at::Tensor trajectories;  // x - r(m), [B, 2T] metres
  SceneFeatures scenes;     // undefined features: p(y) knows no scene
  at::Tensor labels;        // [B] as in BaseModel, or undefined
};

// Returns standard normal noise of a shape. Zeros replace samples by means.
using NoiseSource = std::function<at::Tensor(at::IntArrayRef shape)>;

// Evaluates the base model on a batch: q(z|x), one sample's decoding, p(z|y), p(y|s).
BaseModel ApplyBase(const Networks& networks, const SceneBatch& batch, const NoiseSource& noise);

// Which parts learn from a bound.
enum class Learning {
  kAll,        // everything in it
  kPosterior,  // only q(z|y,s); everything else stays fixed
};

// Returns the bound that `objective` maximises. For DUAL this is the last stage of the dual model,
// which goes with kPosterior.
BoundTerms SceneBound(const Networks& networks, v1::Objective objective, Learning learning,
                      const v1::OptimizationSettings& optimization, const SceneBatch& batch,
                      const NoiseSource& noise);

// Returns ln q(y|x,s) as the engine computes it: that of the base model unless the model is a
// unified one. [B, K]
at::Tensor LogResponsibilities(const Networks& networks, const SceneBatch& batch,
                               const at::Tensor& log_p_y, const Gaussian& posterior);

// Returns the weights of the bound's terms.
//   share: factor from 0 to 1 of the divergences' weights during their warm-up
BoundWeights Weights(const v1::OptimizationSettings& optimization, double share = 1.0);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SCENE_BOUND_H_
