// The target's frame T: origin at the centre of its box at the prediction time, +x along its
// heading, +y to its left.

#ifndef MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
#define MANEUVER_MODEL_SCENE_TARGET_FRAME_H_

#include <cstdint>
#include <optional>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// Times that differ by less are the same, seconds. Clocks are sums of frame intervals and carry
// rounding errors.
inline constexpr double kSameTime = 1e-6;

// Returns the agent with this id, or nullptr.
const v1::Agent* FindAgent(const v1::Scenario& scenario, int64_t agent_id);

// Returns the index into agent.states of the state nearest to `time`, or -1. The state must be
// within `tolerance` seconds (+ kSameTime) of `time` and not after `latest`. Of two that are
// equally near, the later one counts.
int FindState(const v1::Agent& agent, double time, double tolerance, double latest);

// Returns the latest reading of a signal at or before `time` + kSameTime, or nullptr.
const v1::TrafficSignalReading* LatestReading(const v1::TrafficSignal& signal, double time);

// Returns X_WT of an agent at `time`: the pose of its nearest state that is at or before `time` +
// kSameTime and at most `tolerance` seconds old. Returns nothing if there is no such state.
std::optional<Pose2> TargetPose(const v1::Agent& agent, double time, double tolerance);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
