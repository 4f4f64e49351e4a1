// The inputs of a model with scene vectors, for one target.

#ifndef MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_
#define MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_

#include "model/scene/agent_inputs.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/target_history.h"

namespace maneuver::scene {

struct SceneVectors {
  MotionEstimate motion;  // the trajectory reference is rolled out from it
  HistoryInputs history{};
  LanePathInputs paths;  // empty for a model that does not read lane paths
  AgentInputs agents;    // empty for a model that does not read agents
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_
