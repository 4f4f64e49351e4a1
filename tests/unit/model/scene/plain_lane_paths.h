// A second implementation of model/scene/lane_paths.h: straight from the definition, without an
// index, with angles instead of unit vectors, for small maps.

#ifndef MANEUVER_TESTS_UNIT_MODEL_SCENE_PLAIN_LANE_PATHS_H_
#define MANEUVER_TESTS_UNIT_MODEL_SCENE_PLAIN_LANE_PATHS_H_

#include <cstdint>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// Returns the 84 numbers of each path of a target in the recorded world.
std::vector<std::vector<double>> PlainLanePaths(const v1::Scenario& scenario, double time,
                                                int64_t target_id, const Pose2& X_WT, double speed,
                                                int inputs_version);

}  // namespace maneuver::scene

#endif  // MANEUVER_TESTS_UNIT_MODEL_SCENE_PLAIN_LANE_PATHS_H_
