// The agents near a target, as numbers for the networks.
//
// An agent other than the target is described if its latest state is at most OthersTolerance old at
// the given time (target_frame.h), from which it has gone on at its velocity, and its centre is
// less than 50 m from the target's. Its type does not matter. The
// nearest kMostNearAgents of them count, nearest first. Agents at equal distance keep the
// scenario's order.
//
// Row i of AgentInputs describes agent i by kAgentInputs = 24 numbers, in the target's frame. d is
// its distance. v is the target's speed along its heading; (v, 0) is taken for its velocity. t* is
// the time from 0 to 8 s at which agent and target are closest if both keep their velocity, and d*
// is their distance then. t* is 0 if their velocities differ by 1 mm/s or less.
// "By 20 m" means divided by 20 m.
//
//    0,  1  x and y, by 20 m
//    2,  3  exp(-d / 5 m), exp(-d / 20 m)
//    4,  5  cosine and sine of its heading
//    6,  7  its velocity along x and y, by 10 m/s
//    8      its velocity along x minus v, by 10 m/s
//    9      its speed, by 10 m/s
//   10      exp(-speed / 0.5 m/s): 1 if it stands still
//   11      its speed minus that of its earlier state, m/s, clamped to -4 .. 4
//   12      its heading minus that of its earlier state, by 0.25 rad, clamped to -4 .. 4
//   13      1 if it has an earlier state. Without one, 11, 12 and 13 are 0
//   14, 15  its length by 5 m, its width by 2 m
//   16, 17, 18  1 if it is a vehicle, a pedestrian, a cyclist; all 0 for any other type
//   19      t*, by 4 s
//   20, 21  exp(-d* / 2 m), exp(-d* / 8 m)
//   22, 23  x and y of the agent at t*, in the frame that the target has now, by 20 m
//
// An agent's earlier state is the one nearest to half a second before its latest state. It must
// lie within 0.05 s of that time. Differences of heading are wrapped to -pi .. pi.
//
// 0, 1, 6 .. 9, 14, 15, 22 and 23 are clamped to -8 .. 8. All numbers are finite for any finite
// scenario, and none exceeds 8 in magnitude.
//
// A WorldView with scale k gives the numbers of a world whose distances, speeds and boxes are k
// times as large. A mirrored view swaps left and right about the target's x axis: 1, 5, 7, 12 and
// 23 change sign. An SE(2) transform of the whole world leaves the numbers unchanged.
//
// Reads nothing later than the given time. Takes time linear in the number of agents.

#ifndef MANEUVER_MODEL_SCENE_AGENT_INPUTS_H_
#define MANEUVER_MODEL_SCENE_AGENT_INPUTS_H_

#include <array>
#include <cstdint>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"
#include "model/scene/world_view.h"

namespace maneuver::scene {

inline constexpr int kMostNearAgents = 12;
inline constexpr int kAgentInputs = 24;  // numbers per agent

struct AgentInputs {
  int count = 0;  // number of agents, 0 .. kMostNearAgents
  // [kMostNearAgents, kAgentInputs]; rows from `count` on are 0
  std::array<float, kMostNearAgents * kAgentInputs> values{};
};

// Writes the inputs of one target of `scenario` at `time`. ValidateScenario must accept the
// scenario.
//   target_id: the agent to leave out. It need not be in the scenario.
//   X_WT: the target's frame. Position and heading come from here, not from the agent's state.
//   speed: of the target, along its heading, in the recorded world whatever the view's scale, m/s;
//     negative when it moves backwards.
//   inputs_version: ModelSpec.inputs_version
void DescribeAgents(const v1::Scenario& scenario, double time, int64_t target_id, const Pose2& X_WT,
                    double speed, const WorldView& view, int inputs_version, AgentInputs* inputs);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_AGENT_INPUTS_H_
