// What a Scenario must be before anything looks at it.

#ifndef MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_
#define MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/scene/field_violation.h"
#include "model/scene/road_map.h"

namespace maneuver::scene {

// Largest scenario that is accepted.
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
  int max_violations = 16;      // validation stops looking after so many
  double max_coordinate = 1e8;  // metres, either sign
  double max_size = 1'000.0;    // of an agent, metres
  // What no recording of a road can reach, either sign. Values near the largest float would make
  // differences of them infinite.
  double max_heading = 1'000.0;  // radians: headings may count turns
  double max_speed = 1'000.0;    // m/s, along each axis; also of a lane's speed limit
  double max_time = 1e11;        // seconds: times may count from any epoch
  // Whether map_id may stand in for the map; who looks it up checks that it is there.
  bool map_by_id = false;
};

// Returns whether time, position, heading and velocity are finite and within the limits.
bool IsPhysicallyPossible(const v1::AgentState& state, const ScenarioLimits& limits = {});

// What is wrong with the scenario as a whole; empty if nothing is. Looks at all but the targets:
// numbers within the limits, positive sizes, strictly increasing times, unique ids, equal numbers
// of x and y, known enum values, limits. Lines and areas of too few points to be seen are let pass;
// a feature without any point is not.
std::vector<FieldViolation> ValidateScenario(const v1::Scenario& scenario,
                                             const ScenarioLimits& limits);

// What is wrong with a map on its own, by the same rules and with the same field paths.
std::vector<FieldViolation> ValidateMap(const MapFeatures& features, const ScenarioLimits& limits);

// What is wrong with target_ids[target_index] of a scenario that ValidateScenario found good: no
// agent has the id, or the agent has no state within `tolerance` seconds of the prediction time.
// Naming the same target twice is an error of the second.
std::optional<FieldViolation> ValidateTarget(const v1::Scenario& scenario, int target_index,
                                             double tolerance);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_SCENARIO_VALIDATION_H_
