// Predictions of a trained model for many examples, used to fit calibration.

#ifndef MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
#define MANEUVER_MODEL_LEARNING_PREDICTIONS_H_

#include <cstdint>
#include <functional>

#include "model/learning/calibration_steps.h"
#include "model/learning/networks.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

inline constexpr int64_t kEncodedBatch = 64;    // examples that are encoded together
inline constexpr int64_t kPredictedBatch = 32;  // examples that are predicted together

// Features of the scenes of N examples.
struct ExampleFeatures {
  at::Tensor trajectories;  // x - r(m), [N, 2T] metres
  SceneFeatures scenes;
  at::Tensor references;         // r(m), [N, 2T] metres
  at::Tensor speeds;             // [N] m/s
  CountCalibrationStep count{};  // to be called for each batch that is predicted
};

// Encodes at most `most` examples of the source, drawn evenly and not varied; fewer if `stopped`.
//   count: called for each batch; the features keep it
ExampleFeatures EncodeExamples(Networks& networks, const SceneSource& source, int64_t most,
                               int threads, const std::function<bool()>& stopped,
                               const CountCalibrationStep& count);

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
  CountCalibrationStep count{};  // to be called for each step of a fit

  // Counts a step of a fit to all of them.
  void CountStep(CalibrationStep kind) const;
  // Returns the predictions for some of the examples. rows: [M] indices
  Predictions Rows(const at::Tensor& rows) const;
};

// Predicts all examples, without gradients.
Predictions Predict(const Networks& networks, const ExampleFeatures& examples);

// Returns ln p(y|s) alone, with the bits of Predict. [N, K]
at::Tensor PredictLogProbabilities(const Networks& networks, const ExampleFeatures& examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PREDICTIONS_H_
