// Calibrates predicted probabilities and covariances after learning.

#ifndef MANEUVER_MODEL_LEARNING_CALIBRATION_H_
#define MANEUVER_MODEL_LEARNING_CALIBRATION_H_

#include <cstdint>
#include <functional>

#include "absl/status/status.h"
#include "model/artifact/calibration_examples.h"
#include "model/learning/calibration_steps.h"
#include "model/learning/networks.h"
#include "model/learning/scene_source.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

using artifact::CalibrationExamples;
using artifact::kFewestHeldOut;

// Returns the temperature T of the softmax p(y|s), in [1/4, 4], that makes held-out trajectories
// most likely. It maximises
//   L(T) = sum_i ln sum_y p_T(y|s_i) e^(v_iy),  v = ln q(y|x,s) - ln p(y|s),
// where v is what the trajectory tells of its action. Both arguments are [N, K], at T = 1; ln q may
// be -inf.
double FitTemperature(const at::Tensor& log_probabilities, const at::Tensor& log_responsibilities);

// How a model is calibrated.
struct CalibrationRun {
  CalibrationExamples most;  // examples that are read of each source, drawn evenly
  int threads = 1;
  at::Generator& generator;
  const std::function<bool()>& stopped;
  const CountCalibrationStep& count;  // called after each step
};

// Calibrates what the settings ask for, in this order, each with the earlier ones in place:
//   1. the width of q(z|y,s), in the scenario encoders' last bias;
//   2. the temperature of p(y|s), in the action predictor's last layer;
//   3. the covariance of p(x|z): fitted to training examples, scaled along the horizon to held-out
//     ones, and widened until it covers enough of them (covariance_fit.h). A covariance that the
//     scene predicts was learned before; here its speed factors are fitted to held-out examples
//     (speed_factors.h);
//   4. mixture.log_weight, the mean of p(y|s).
// With fewer than kFewestHeldOut held-out examples, leaves out what is fitted to them. CANCELLED if
// `stopped` returns true; the networks are then calibrated in part.
absl::Status CalibrateModel(Networks& networks, const SceneSource& training,
                            const SceneSource& held_out,
                            const v1::OptimizationSettings& optimization,
                            const CalibrationRun& run);

// Fits what CalibrateModel fits to held-out examples, of a model that is calibrated already: the
// temperature of p(y|s), then the width of p(x|z), whether or not the model's settings asked for
// them. Leaves everything else as it is, also q(z|y,s).
//   most: examples that are read, drawn evenly
// FAILED_PRECONDITION if there are fewer than kFewestHeldOut; CANCELLED if `stopped` returns true.
absl::Status RecalibrateModel(Networks& networks, const SceneSource& examples, int64_t most,
                              double covered_share, int threads,
                              const std::function<bool()>& stopped,
                              const CountCalibrationStep& count);

// Returns the steps that RecalibrateModel takes for this many examples.
CalibrationPlan PlanRecalibration(const v1::ModelSpec& spec, int64_t examples);

// Returns the steps that CalibrateModel takes. The settings are complete.
CalibrationPlan PlanCalibration(const v1::TrainingSettings& settings,
                                const CalibrationExamples& examples);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CALIBRATION_H_
