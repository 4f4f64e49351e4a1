#include "model/data/agent_size.h"

namespace maneuver::data {

AgentSize TypicalSize(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_VEHICLE:
      return {4.6F, 2.1F};
    case v1::AGENT_TYPE_CYCLIST:
      return {1.8F, 0.8F};
    default:
      return {0.9F, 0.9F};
  }
}

}  // namespace maneuver::data
