// The generic mean trajectory of an action, as a manifest stores it.

#ifndef MANEUVER_MODEL_EVALUATION_GENERIC_MEAN_H_
#define MANEUVER_MODEL_EVALUATION_GENERIC_MEAN_H_

#include <optional>

#include "maneuver/v1/model.pb.h"
#include "model/inference/trajectory_set.h"

namespace maneuver::evaluation {

// Returns the mean of p(z|y) decoded, [T, 2] target frame, metres. Returns nothing if the action has
// no mean trajectory, or one with unequal numbers of x and y.
std::optional<inference::Trajectory> GenericMean(const v1::Action& action);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_GENERIC_MEAN_H_
