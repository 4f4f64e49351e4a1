// What a model with scene vectors reads of a scene, for one target.

#ifndef MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_
#define MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_

#include "model/scene/agent_inputs.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/target_history.h"

namespace maneuver::scene {

struct SceneVectors {
  MotionEstimate motion;  // what the trajectory reference is rolled out from
  HistoryInputs history{};
  LanePathInputs paths;  // none of a model that does not read lane paths
  AgentInputs agents;    // none of a model that does not read agents
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENE_VECTORS_H_
