// Small recordings that validation accepts.

#ifndef MANEUVER_TESTS_UNIT_MODEL_DATA_RECORDINGS_FOR_TESTS_H_
#define MANEUVER_TESTS_UNIT_MODEL_DATA_RECORDINGS_FOR_TESTS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Returns a recording from 0 to 5 s: a vehicle at `speed` along +x, a standing pedestrian, one
// lane.
inline v1::Scenario SmallRecording(const std::string& id, double speed = 10.0) {
  v1::Scenario scenario;
  scenario.set_scenario_id(id);
  scenario.set_prediction_time(1.0);
  for (const auto type : {v1::AGENT_TYPE_VEHICLE, v1::AGENT_TYPE_PEDESTRIAN}) {
    v1::Agent* agent = scenario.add_agents();
    agent->set_id(scenario.agents_size());
    agent->set_type(type);
    agent->set_length(4.0);
    agent->set_width(2.0);
    for (int i = 0; i <= 50; ++i) {
      v1::AgentState* state = agent->add_states();
      state->set_time(0.1 * i);
      state->set_x(type == v1::AGENT_TYPE_VEHICLE ? 0.1 * i * speed : 5.0);
      state->set_y(type == v1::AGENT_TYPE_VEHICLE ? 0.0 : 5.0);
    }
  }
  v1::MapFeature* lane = scenario.add_map_features();
  lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
  for (const double x : {0.0, 100.0}) {
    lane->add_x(x);
    lane->add_y(0.0);
  }
  return scenario;
}

// Returns the names of what a store lists; the error's text if it lists nothing.
inline std::vector<std::string> NamesOf(const absl::StatusOr<std::vector<v1::Dataset>>& datasets) {
  if (!datasets.ok()) return {datasets.status().ToString()};
  std::vector<std::string> names;
  for (const v1::Dataset& dataset : *datasets) names.push_back(dataset.name());
  return names;
}

}  // namespace maneuver::data

#endif  // MANEUVER_TESTS_UNIT_MODEL_DATA_RECORDINGS_FOR_TESTS_H_
