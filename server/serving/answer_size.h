// Bounds the size of an answer before any of it is computed.

#ifndef MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_
#define MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_

#include <cstdint>

#include "maneuver/v1/model_spec.pb.h"
#include "server/serving/prediction_call.h"

namespace maneuver::serving {

// The largest size of a scenario's names, or of its error with its details.
inline constexpr int64_t kScenarioBytes = 4096;
// The largest size of a target's error with its details.
inline constexpr int64_t kTargetErrorBytes = 768;

// Returns the largest size on the wire that the answer for one target, or its error, can have. If
// the question asks for actions of probability p or more, that is at most 1 / p actions.
//   sigma_trajectories: whether the answer carries them.
int64_t MostBytesOfTarget(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories);

// Returns the largest size of the answer for `targets` targets of `scenarios` scenarios.
int64_t MostBytesOfAnswer(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories, int scenarios, int targets);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_
