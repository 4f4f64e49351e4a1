// The target's frame T: origin at the centre of its box at the prediction time, +x along its
// heading, +y to its left.

#ifndef MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
#define MANEUVER_MODEL_SCENE_TARGET_FRAME_H_

#include <cstdint>
#include <optional>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// Times that differ by less are the same, seconds: clocks are sums of frame intervals and carry
// their rounding.
inline constexpr double kSameTime = 1e-6;

// The agent with this id, or nullptr.
const v1::Agent* FindAgent(const v1::Scenario& scenario, int64_t agent_id);

// Index into agent.states of the state nearest to `time` and no further than `tolerance` seconds
// (+ kSameTime) from it, or -1; the later of two that are as near. Never a state after `latest`.
int FindState(const v1::Agent& agent, double time, double tolerance, double latest);

// X_WT of an agent at `time`, from its state within `tolerance` seconds at or before
// `time` + kSameTime; nothing if it has none.
std::optional<Pose2> TargetPose(const v1::Agent& agent, double time, double tolerance);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
