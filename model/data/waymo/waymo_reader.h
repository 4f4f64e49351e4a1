// Reads scenarios of the Waymo Open Motion Dataset.

#ifndef MANEUVER_MODEL_DATA_WAYMO_WAYMO_READER_H_
#define MANEUVER_MODEL_DATA_WAYMO_WAYMO_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Parses one serialised waymo.open_dataset.Scenario. prediction_time is the time of
// current_time_index (step 10 if it is not stated). The targets are those tracks_to_predict that
// have a state at that time. A recording without an id gets one from its content: "nosid-" and
// eight hexadecimal digits.
//
// Keeps valid states with finite numbers, agents that have any state, and map features that have
// any point. An agent's size is that of its state nearest to the prediction time. If no state has a
// size, as in some copies of the dataset, it is typical of the agent's type. A signal has one
// reading per change; it becomes "unspecified" where the recording no longer states it.
//
// Lanes declare their successors (exit_lanes, and the entry_lanes of other lanes) and neighbours,
// as many as ScenarioLimits accepts.
//
// INVALID_ARGUMENT if it does not parse, has no tracks or more than two million states, points and
// other parts, its times do not increase or do not match its states, or current_time_index is none
// of them.
absl::StatusOr<v1::Scenario> ParseWaymoScenario(std::string_view serialized);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_WAYMO_WAYMO_READER_H_
