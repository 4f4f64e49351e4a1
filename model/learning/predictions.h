// Predictions of a trained model for many examples, used to fit calibration.

#ifndef MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
#define MANEUVER_MODEL_LEARNING_PREDICTIONS_H_

#include <algorithm>
#include <cstdint>
#include <functional>

#include "model/learning/networks.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

inline constexpr int64_t kEncodedBatch = 64;    // examples that are encoded together
inline constexpr int64_t kPredictedBatch = 32;  // examples that are predicted together
// Calibration counts its progress in steps that take about as long as encoding a batch. Predicting
// a batch counts as this many steps.
inline constexpr int64_t kPredictedSteps = 3;
// Returns how many of these steps one step of a fit to `examples` examples counts for.
inline int64_t FitSteps(int64_t examples) { return std::max<int64_t>(1, examples / 150); }

// Features of the scenes of N examples.
struct ExampleFeatures {
  at::Tensor trajectories;  // x - r(m), [N, 2T] metres
  SceneFeatures scenes;
  at::Tensor references;  // r(m), [N, 2T] metres
  at::Tensor speeds;      // [N] m/s
  // Counts progress: called kPredictedSteps times for each batch that is predicted; may be empty.
  std::function<void(int64_t)> step{};
};

// Encodes at most `most` examples of the source, drawn evenly and not varied; fewer if `stopped`.
//   step: called with the number of examples of each batch; Predict goes on calling it, with 0
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
  // The parts of the decoder's covariance that the scene predicts, along and across the mean; only
  // with scene_covariance. [N, K, T, 3] xx, xy, yy, square metres
  at::Tensor along{};
  at::Tensor across{};
  // Counts progress; may be empty.
  std::function<void(int64_t)> step{};

  // Counts one step of a fit to `examples` examples.
  void CountFit(int64_t examples) const;
  // Returns the predictions for some of the examples. rows: [M] indices
  Predictions Rows(const at::Tensor& rows) const;
};

Predictions Predict(const Networks& networks, const ExampleFeatures& examples);

// Returns ln p(y|s) alone, with the bits of Predict. [N, K]
at::Tensor PredictLogProbabilities(const Networks& networks, const ExampleFeatures& examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
