// One scene of nuScenes, and the scenario that is made of it.

#ifndef MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_SCENE_H_
#define MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_SCENE_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/data/city_map.h"
#include "model/data/nuscenes/keyframes.h"

namespace maneuver::data {

// An instance within a scene.
struct NuScenesTrack {
  std::string token;                     // of the instance
  std::string category;                  // "vehicle.car"
  float length = 0.0F;                   // metres, of the first annotation
  float width = 0.0F;                    // metres
  bool ridden = false;                   // an annotation says cycle.with_rider
  bool unridden = false;                 // an annotation says cycle.without_rider
  std::vector<Keyframe> keyframes = {};  // in any order; times from the scene's first sample on
};

struct NuScenesScene {
  std::string name;
  std::string log;        // file name of the drive
  std::string location;   // "boston-seaport"
  double duration = 0.0;  // from the first to the last sample, seconds
  std::vector<NuScenesTrack> tracks;
  std::vector<Keyframe> ego;  // poses of the recording car's rear axle, in any order
  std::string damage;         // why the scene cannot be used; empty: it can
};

// Makes a scenario of a scene.
//   - scenario_id: "LOG#SCENE", so the scenes of one drive count as parts of one recording
//     (recording_split.h).
//   - Frames every 0.1 s, from the scene's first sample on: keyframes.h.
//   - The recording car is agent 0, a Renault Zoe. Its poses come at 20 Hz; those less than 0.075 s
//     after the one before are left out. They are of the rear axle, so its centre is put 1.385 m
//     ahead of them.
//   - Other ids are 52 bits of a hash of the instance's token. An instance with one annotation
//     alone has no velocity and is left out.
//   - Types: vehicle.* is a vehicle, also a motorcycle. vehicle.bicycle is a cyclist, unless all
//     its annotations say that nobody rides it. human.pedestrian.* is a pedestrian, except
//     strollers and personal mobility. All else is of another type: barriers, cones, animals.
//   - prediction_time: 2 s after the beginning, the history that the dataset's prediction task has.
//     No targets. No signals: the dataset does not say what lights show.
//   map: the surroundings of the recording car's path; null: no map
// INVALID_ARGUMENT if the scene is damaged.
absl::StatusOr<v1::Scenario> ScenarioOf(const NuScenesScene& scene, const CityMap* map);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_NUSCENES_NUSCENES_SCENE_H_
