// What the networks read about a target's lane paths. LanePathFinder (lane_paths.h) fills it.

#ifndef MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_
#define MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_

#include <array>

namespace maneuver::scene {

inline constexpr int kMostLanePaths = 6;
inline constexpr int kLanePathInputs = 84;  // numbers per path

// The paths of one target. lane_paths.h lays out a row.
struct LanePathInputs {
  int count = 0;  // number of paths, 0 .. kMostLanePaths
  // [kMostLanePaths, kLanePathInputs]; rows from `count` on are 0
  std::array<float, kMostLanePaths * kLanePathInputs> values{};
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_
