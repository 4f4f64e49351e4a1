// Finds what looks wrong in a valid scenario, such as degrees in place of radians.

#ifndef MANEUVER_MODEL_SCENE_SCENE_WARNINGS_H_
#define MANEUVER_MODEL_SCENE_SCENE_WARNINGS_H_

#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/field_violation.h"
#include "model/scene/road_map.h"

namespace maneuver::scene {

// A scene looks wrong if a value exceeds its limit here, which recordings of real roads do not; if
// a target's velocity contradicts its positions or its heading (not checked of pedestrians and
// OTHER); or if a signal names a lane that the map lacks.
struct SceneWarningLimits {
  int max_warnings = 8;                // the search stops after this many
  double max_heading = 4.0 * 3.14160;  // radians, either sign: two turns
  double max_vehicle_speed = 90.0;     // m/s; also for agents of type OTHER or without a type
  double max_cyclist_speed = 30.0;     // m/s
  double max_pedestrian_speed = 13.0;  // m/s
  double max_length = 60.0;            // metres
  double max_width = 20.0;             // metres
  double max_vehicle_width = 1.8;      // lengths
  double max_target_distance = 100.0;  // metres from the box of the nearest map feature
  double max_agent_distance = 1000.0;  // metres from the box of the whole map
  double max_gap = 10.0;               // seconds between a target's latest two states
};

// Returns what looks wrong in the scenario as predictions read it: states at the prediction time,
// those of targets also over the second before it, the signals, and where the map is. Empty for a
// scene that looks right. Each field path is within the scenario. ValidateScenario must accept the
// scenario.
//   map: the scenario's own features, or those that its map_id names. Without features, nothing is
//     far from the map.
//   tolerance: how old a state at the prediction time may be, seconds.
// Takes a few nanoseconds for each agent and each map feature.
std::vector<FieldViolation> FindSceneWarnings(const v1::Scenario& scenario, const RoadMap& map,
                                              double tolerance,
                                              const SceneWarningLimits& limits = {});

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENE_WARNINGS_H_
