// Checks a Scenario before any other code reads it.

#ifndef MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_
#define MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/field_violation.h"
#include "model/scene/road_map.h"

namespace maneuver::scene {

// The limits of a scenario that is accepted.
struct ScenarioLimits {
  int max_scenario_id = 128;  // characters
  int max_agents = 2'000;
  int max_states_per_agent = 2'000;
  int max_map_features = 20'000;
  int max_map_points = 500'000;  // over all features
  int max_lane_links = 64;       // of one kind (successors, left, right neighbours) of a feature
  int max_targets = 1'000;
  int max_traffic_signals = 2'000;
  int max_readings_per_signal = 2'000;
  int max_violations = 16;      // validation stops after this many
  double max_coordinate = 1e8;  // metres, either sign
  double max_size = 1'000.0;    // of an agent, metres
  // Limits that no recording of a road reaches, either sign. Without them, differences of values
  // near the largest float would be infinite.
  double max_heading = 1'000.0;  // radians: headings may count turns
  double max_speed = 1'000.0;    // m/s, along each axis; also of a lane's speed limit
  double max_time = 1e11;        // seconds: times may count from any epoch
  // Whether map_id may replace the map. The caller that looks the id up checks that it exists.
  bool map_by_id = false;
};

// Returns whether time, position, heading and velocity are finite and within the limits.
bool IsPhysicallyPossible(const v1::AgentState& state, const ScenarioLimits& limits = {});

// Returns what is wrong with the scenario, targets aside; empty if nothing is. Checks that numbers
// are within the limits, sizes positive, speed limits not negative, times strictly increasing, ids
// of agents unique, the scenario's id UTF-8, enum values known, and that x and y have equal length.
// Also refuses a map_id beside map features. Accepts lines and areas with too few points to be
// drawn, but no feature without a point.
//   boxes: if not nullptr, gets the box of each map feature of a scenario that is accepted. Finding
//     them is most of the check, so RoadMap::Over need not find them again.
std::vector<FieldViolation> ValidateScenario(const v1::Scenario& scenario,
                                             const ScenarioLimits& limits,
                                             std::vector<Box>* boxes = nullptr);

// Returns what is wrong with a map on its own, by the same rules and with the same field paths.
std::vector<FieldViolation> ValidateMap(const MapFeatures& features, const ScenarioLimits& limits);

// Returns what is wrong with target_ids[target_index] of a scenario that ValidateScenario accepts:
// no agent has the id, the agent has no state in the `tolerance` seconds up to the prediction time,
// or an earlier entry names the same target.
std::optional<FieldViolation> ValidateTarget(const v1::Scenario& scenario, int target_index,
                                             double tolerance);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_
