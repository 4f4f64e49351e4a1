// Sizes of road users whose recording states none.

#ifndef MANEUVER_MODEL_DATA_AGENT_SIZE_H_
#define MANEUVER_MODEL_DATA_AGENT_SIZE_H_

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

struct AgentSize {
  float length = 0.0F;  // metres
  float width = 0.0F;   // metres
};

// Returns the median size of agents of a type, over recordings that state sizes.
AgentSize TypicalSize(v1::AgentType type);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_AGENT_SIZE_H_
