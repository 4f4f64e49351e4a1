// Waymo Open Motion scenarios as ours.

#ifndef MANEUVER_MODEL_DATA_WAYMO_READER_H_
#define MANEUVER_MODEL_DATA_WAYMO_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// One serialised waymo.open_dataset.Scenario. prediction_time is that of current_time_index, targets
// are tracks_to_predict (or, without those, none). INVALID_ARGUMENT if it does not parse or has no
// tracks.
absl::StatusOr<v1::Scenario> ParseWaymoScenario(std::string_view serialized);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_WAYMO_READER_H_
