// CommonRoad scenarios (commonroad.in.tum.de, XML of versions 2018b and 2020a) as ours.

#ifndef MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_
#define MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// One file. The recording's id is its benchmarkID (without one, "nosid-" and eight hexadecimal
// digits of its content); prediction_time is one second after its first step, or its last step if
// that is earlier; it names no targets. Planning problems are left out: nobody drove them.
//
// Kept: obstacles with a position at any time. An obstacle's states are its initial state and its
// trajectory; its velocity points along its heading. Those of a static obstacle are repeated at
// every step of the scenario. Where a value is an interval, its middle; where a position is an
// area, its centre. A shape other than a rectangle has the box around it. Lanelets become
// centrelines, lines and edges as lanelet_map.h says; traffic lights, what their cycles show to the
// lanelets that refer to them.
//
// INVALID_ARGUMENT, with the element, if it is no XML or no CommonRoad scenario, is of another
// version, has no obstacles, or lacks an element that its version requires.
absl::StatusOr<v1::Scenario> ParseCommonRoad(std::string_view xml);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_
