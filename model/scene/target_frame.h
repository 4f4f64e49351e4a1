// The target's frame T: origin at the centre of its box at the prediction time, +x along its
// heading, +y to its left.

#ifndef MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
#define MANEUVER_MODEL_SCENE_TARGET_FRAME_H_

#include <cstdint>
#include <optional>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/inputs_version.h"
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

// Where an agent is at a time.
struct PresentState {
  const v1::AgentState* state;  // the latest at or before that time (+ kSameTime)
  Point2 position;              // world, metres
};

// Returns where an agent is at `time`; nothing if its latest state is more than `tolerance` seconds
// old (+ kSameTime). From that state it has gone on at the state's velocity. With versions 1 and 2
// of the inputs (inputs_version.h) it is where the state says.
std::optional<PresentState> PresentOf(const v1::Agent& agent, double time, double tolerance,
                                      int inputs_version);

// Returns X_WT of an agent at `time`: its position as PresentOf has it, and the heading of that
// state. Returns nothing if there is no such state.
std::optional<Pose2> TargetPose(const v1::Agent& agent, double time, double tolerance,
                                int inputs_version = kLatestInputsVersion);

// Returns how old the state of an agent that is not the target may be, seconds, for the agent to
// count: one frame at 10 Hz may be missing. With versions 1 and 2 it may not.
constexpr double OthersTolerance(int inputs_version) { return inputs_version < 3 ? 0.05 : 0.125; }

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_TARGET_FRAME_H_
