// Calibrates the covariance that the scene predicts, by the speed of the target
// (scene_covariance.speed_factor in tensor.h).

#ifndef MANEUVER_MODEL_LEARNING_SPEED_FACTORS_H_
#define MANEUVER_MODEL_LEARNING_SPEED_FACTORS_H_

#include <cstdint>

#include "model/learning/calibration_steps.h"
#include "model/learning/predictions.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns the bin of scene_covariance.speed_factor for each speed in m/s. [N]
at::Tensor SpeedBins(const at::Tensor& speeds);

// Returns the factors f of the along and across variances for each speed bin b, [6, 2], that make
// held-out trajectories most likely under the mixture over p(y|s). Bins with few of the N examples
// are drawn towards the mean of all bins. Minimises, with L as for NllGradient:
//
//   L + 150 / N sum_{b,d} (ln f_bd - mean_b' ln f_b'd)^2
//
at::Tensor FitSpeedFactors(const Predictions& held_out);
// Returns the steps that FitSpeedFactors takes for this many examples.
PlannedSteps SpeedFactorSteps(int64_t examples);

// Returns `factors`, multiplied by the smallest number from 1/16 to 16 that makes the covered share
// at least `share` (ScaleToCover in covariance_fit.h): one number for the bin of standing targets,
// whose errors are rare but large, and one for all other bins together. A part with fewer than 100
// examples uses the number for all examples.
at::Tensor ScaleToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share);

// Returns the decoder's covariance with the speed factors applied. [N, K, T, 3] square metres
at::Tensor WithSpeedFactors(const Predictions& predictions, const at::Tensor& factors);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_SPEED_FACTORS_H_
