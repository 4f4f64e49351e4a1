// What the networks read about a target's lane paths. LanePathFinder (lane_paths.h) fills it.

#ifndef MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_
#define MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_

#include <array>

namespace maneuver::scene {

inline constexpr int kMostLanePaths = 6;
inline constexpr int kLanePathInputs = 84;  // numbers per path

// Arc lengths of a path's points from the foot, metres.
inline constexpr std::array<double, 13> kLanePathDistances = {
    2.5, 5.0, 7.5, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0};

// Where the numbers of a path begin in its row; lane_paths.h says what they are. What recordings may
// lack is also listed in kMayBeMissing (model/learning/networks.cc).
struct LanePathRow {
  enum : int {
    kPoints = 0,
    kCosines = 26,
    kSines = 39,
    kLookAhead = 52,
    kOffset = 62,
    kHeadingSine = 63,
    kHeadingCosine = 64,
    kLengthLeft = 65,
    kSpeedLimit = 68,
    kHasLeader = 69,
    kLeaderGap = 70,
    kLeaderSpeed = 71,
    kSignal = 74,
    kHasStopSign = 81,
    kStopSignDistance = 82,
  };
  // Metres and m/s by which gaps to things ahead and their speeds are divided.
  static constexpr double kGapScale = 30.0;
  static constexpr double kSpeedScale = 10.0;
};

// The paths of one target.
struct LanePathInputs {
  int count = 0;  // number of paths, 0 .. kMostLanePaths
  // [kMostLanePaths, kLanePathInputs]; rows from `count` on are 0
  std::array<float, kMostLanePaths * kLanePathInputs> values{};
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_LANE_PATH_INPUTS_H_
