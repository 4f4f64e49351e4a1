// Chooses the agents to ask about when the user names none.

#ifndef MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_
#define MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::cli {

// Returns the index of the agent's latest state at most 0.05 s, half a frame, before `time`; -1 if
// there is none.
int CurrentState(const v1::Agent& agent, double time);

// Returns at most `most` agents of a type that can be predicted at `time`: visible then and a
// second earlier, and at least 0.5 m further on; fastest first. Uses no later states.
std::vector<int64_t> MovingAgents(const v1::Scenario& scenario, v1::AgentType type, double time,
                                  int most);

// Returns those targets of the recording that have this type and are visible at `time`. If there are
// none, returns at most eight MovingAgents.
std::vector<int64_t> DefaultTargets(const v1::Scenario& scenario, v1::AgentType type, double time);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TARGET_SELECTION_H_
