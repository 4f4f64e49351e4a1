// Which agents to ask about when nobody says.

#ifndef MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_
#define MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::cli {

// Index of the agent's latest state at most half a frame of 0.1 s before `time`, or -1.
int CurrentState(const v1::Agent& agent, double time);

// Returns agents of a type that can be asked about at `time`: in sight then and a second before,
// moving, fastest first, at most `most` of them. Looks at nothing later than `time`.
std::vector<int64_t> MovingAgents(const v1::Scenario& scenario, v1::AgentType type, double time,
                                  int most);

// Returns the agents of a type among the targets that the recording names, those that are in sight
// at `time`; or, without any, MovingAgents.
std::vector<int64_t> DefaultTargets(const v1::Scenario& scenario, v1::AgentType type, double time);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_
