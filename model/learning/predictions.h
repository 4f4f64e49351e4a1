// What a trained model says of many examples, for what is fitted to its answers.

#ifndef MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
#define MANEUVER_MODEL_LEARNING_PREDICTIONS_H_

#include <cstdint>
#include <functional>

#include "model/learning/networks.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// What the networks make of N examples' scenes.
struct ExampleFeatures {
  at::Tensor trajectories;  // x - r(m), [N, 2T] metres
  SceneFeatures scenes;
  at::Tensor references;  // r(m), [N, 2T] metres
  at::Tensor speeds;      // [N] m/s
};

// At most `most` examples of the source, drawn evenly, not varied. Fewer if `stopped`.
//   step: called with the number of examples of each batch
ExampleFeatures EncodeExamples(Networks& networks, const SceneSource& source, int64_t most,
                               int threads, const std::function<bool()>& stopped,
                               const std::function<void(int64_t)>& step);

// What a model predicts for N examples, relative to their references and without the decoder's
// covariance.
struct Predictions {
  at::Tensor trajectories;          // x - r(m), [N, 2T] metres
  at::Tensor log_probabilities;     // ln p(y|s), [N, K]
  at::Tensor log_responsibilities;  // ln q(y|x,s), [N, K]
  at::Tensor mean;                  // [N, K, T, 2] metres
  at::Tensor covariance;            // latent, [N, K, T, 3] square metres
  at::Tensor latents{};             // means of q(z|y,s), [N, K, D]; of anchors, undefined
  at::Tensor speeds{};              // along the heading, [N] m/s; of anchors, undefined
  // What the scene predicts of the decoder's covariance, with scene_covariance alone: [N, K, T, 3]
  // xx, xy, yy of each of along and across its own, square metres.
  at::Tensor along{};
  at::Tensor across{};

  // Of some of the examples. rows: [M]
  Predictions Rows(const at::Tensor& rows) const;
};

Predictions Predict(const Networks& networks, const ExampleFeatures& examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
