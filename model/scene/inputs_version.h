// The version of the rules by which a scene becomes a model's inputs (ModelSpec.inputs_version).
//
// A model keeps the rules that it was trained with, so its answers do not change when a rule does.
// Each rule stands where it is applied, with what version 1 has instead:
//
//   - the reference of a vehicle that has just stopped: motion_reference.h
//   - which of several lane paths that lead the same way count: lane_paths.h
//   - the direction of a lane that begins or ends near the target: action_geometry.h
//   - since version 3, where an agent is whose latest state is a little old: target_frame.h
//   - since version 3, how far away a signal or a stop sign is that is not there: lane_paths.h
//
// 0 means 1. Versions are of rules, not of sizes: with another kLanePathInputs, kAgentInputs,
// kHistoryInputs, kPairNumbers or kActionNumbers no stored model that reads these numbers loads
// (CONTRIBUTING.md, "Add a number that the networks read").

#ifndef MANEUVER_MODEL_SCENE_INPUTS_VERSION_H_
#define MANEUVER_MODEL_SCENE_INPUTS_VERSION_H_

namespace maneuver::scene {

inline constexpr int kLatestInputsVersion = 3;

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_INPUTS_VERSION_H_
