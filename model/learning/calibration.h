// After learning: what the predicted probabilities and covariances are worth.

#ifndef MANEUVER_MODEL_LEARNING_CALIBRATION_H_
#define MANEUVER_MODEL_LEARNING_CALIBRATION_H_

#include <cstdint>
#include <functional>

#include "absl/status/status.h"
#include "model/learning/networks.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// The temperature that p(y|s) is divided by so that held-out q(y|x,s) is most likely under it.
double FitTemperature(const at::Tensor& log_probabilities, const at::Tensor& log_responsibilities);

// What the settings ask for, in this order, each with the ones before it in place: the width of
// q(z|y,s) (into the scenario encoders' last bias), the temperature of p(y|s) (into the action
// predictor's last layer), and the covariance of p(x|z): fitted to examples that were learned from,
// scaled along the horizon to held-out ones, widened until it covers enough of them
// (covariance_fit.h). A covariance that the scene predicts has been learned before; here its
// factors by speed are fitted to held-out examples (scene_covariance.h). Then mixture.log_weight,
// the mean of p(y|s).
//   step: called with the number of examples of each batch that was looked at
absl::Status CalibrateModel(Networks& networks, const SceneSource& training_source,
                            const SceneSource& held_out_source,
                            const v1::OptimizationSettings& optimization, int threads,
                            at::Generator& generator, const std::function<bool()>& stopped,
                            const std::function<void(int64_t)>& step);

// About how often CalibrateModel calls `step`.
int64_t CalibrationSteps(int64_t training_examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CALIBRATION_H_
