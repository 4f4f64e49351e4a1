// Waymo Open Motion scenarios as ours.

#ifndef MANEUVER_MODEL_DATA_WAYMO_READER_H_
#define MANEUVER_MODEL_DATA_WAYMO_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// One serialised waymo.open_dataset.Scenario. prediction_time is that of current_time_index (step
// 10 where it is not stated), targets are tracks_to_predict with a state then (without those,
// none). A recording without an id gets one of its content: "nosid-" and eight hexadecimal digits.
//
// Kept: valid states with finite numbers; agents that have any; map features that have any points.
// An agent's size is that of its state nearest to the prediction time; where no state has one (some
// copies of these recordings come without), one typical of its type. A signal has a reading where
// it changes, "unspecified" where the recording stops telling.
//
// Lanes declare their successors (exit_lanes, and the entry_lanes of others) and neighbours, as
// many as ScenarioLimits accepts.
//
// INVALID_ARGUMENT if it does not parse, has no tracks, or its times do not increase or do not
// match its states.
absl::StatusOr<v1::Scenario> ParseWaymoScenario(std::string_view serialized);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_WAYMO_READER_H_
