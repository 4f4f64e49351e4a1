// After learning: what the predicted probabilities and covariances are worth.

#ifndef MANEUVER_MODEL_LEARNING_CALIBRATION_H_
#define MANEUVER_MODEL_LEARNING_CALIBRATION_H_

#include <ATen/ATen.h>

#include <cstdint>
#include <functional>

#include "absl/status/status.h"
#include "model/learning/networks.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// What a trained model predicts for N examples, without the decoder's covariance.
struct Predictions {
  at::Tensor trajectories;          // [N, 2T] metres
  at::Tensor log_probabilities;     // ln p(y|s), [N, K]
  at::Tensor log_responsibilities;  // ln q(y|x,s), [N, K]
  at::Tensor mean;                  // [N, K, T, 2] metres
  at::Tensor covariance;            // latent, [N, K, T, 3] square metres
};

// At most `most` examples of the set, drawn evenly, not varied. Fewer if `stopped`.
//   step: called with the number of examples of each batch
Predictions Predict(Networks& networks, const ExampleSet& set, int64_t most, int threads,
                    const std::function<bool()>& stopped, const std::function<void(int64_t)>& step);

// The covariance that p(x|z) adds to each action and waypoint, [K, T, 3]: first the residuals
// around the mean trajectory, weighted by q(y|x,s), less what the latent covariance already
// explains; from there up the likelihood of the mixture (what an evaluation calls its NLL).
at::Tensor FitDecoderCovariance(const Predictions& predictions, at::Generator& generator);

// Factor for the covariance of each waypoint, [T], smooth over the horizon, that makes held-out
// trajectories most likely under the actions that they are, weighted by q(y|x,s): residuals on
// examples that were learned from are too small, and each action has to hold its own.
//   covariance: [K, T, 3], or one for each example, [N, K, T, 3]
at::Tensor FitCovarianceScale(const Predictions& held_out, const at::Tensor& covariance);

// The temperature that p(y|s) is divided by so that held-out q(y|x,s) is most likely under it.
double FitTemperature(const at::Tensor& log_probabilities, const at::Tensor& log_responsibilities);

// Sets decoder.covariance (fitted, or the fixed one of the settings) and mixture.log_weight (the
// mean of p(y|s)), and folds the temperature into the action predictor's last layer if the settings
// ask for it.
//   step: called with the number of examples of each batch that was looked at
absl::Status CalibrateModel(Networks& networks, const TrainingData& data,
                            const v1::OptimizationSettings& optimization, int threads,
                            at::Generator& generator, const std::function<bool()>& stopped,
                            const std::function<void(int64_t)>& step);

// About how often CalibrateModel calls `step`.
int64_t CalibrationSteps(int64_t training_examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CALIBRATION_H_
