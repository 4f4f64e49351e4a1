// How many bytes an answer may have, known before any of it is computed.

#ifndef MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_
#define MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_

#include <cstdint>

#include "maneuver/v1/model_spec.pb.h"
#include "server/serving/prediction_call.h"

namespace maneuver::serving {

// The most bytes of one scenario's names, or of its error with its details.
inline constexpr int64_t kScenarioBytes = 4096;
// The most bytes of one target's error with its details.
inline constexpr int64_t kTargetErrorBytes = 768;

// Returns the most bytes, as they go over the wire, that the answer for one target can have, or its
// error.
// Actions that are chosen by their probability p are at most 1 / p.
//   sigma_trajectories: whether the answer carries them.
int64_t MostBytesOfTarget(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories);

// Returns the most bytes that the answer for `targets` targets of `scenarios` scenarios can have.
int64_t MostBytesOfAnswer(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories, int scenarios, int targets);

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_ANSWER_SIZE_H_
