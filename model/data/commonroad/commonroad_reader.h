// Reads CommonRoad scenarios (commonroad.in.tum.de, XML of versions 2018b and 2020a).

#ifndef MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_
#define MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Parses one file. The recording's id is its benchmarkID, or "nosid-" and eight hexadecimal digits
// of a hash of its content. prediction_time is one second after its first step, or its last step if
// that is earlier. The scenario names no targets. Planning problems are ignored: nobody drove them.
//
// Keeps obstacles that have a position at any time. An obstacle's states are its initial state and
// its trajectory, without those whose position is given only by lanelets. A velocity points along
// the heading. Where none is stated, it is the way from the state before over the time between
// both; for the first state, the way to the next one; 0 for a state alone. The state of a static
// obstacle is repeated at each later step of the scenario, up to
// ScenarioLimits::max_states_per_agent states. An interval counts as its middle, and an area in
// place of a position as its centre. A shape counts as the box around it, and the box's centre as
// the obstacle's place.
// Lanelets become centrelines, lines and edges as lanelet_map.h says.
//
// A traffic light stands at the end of the lanelets that refer to it. So it controls their
// successors, as signals do in a Scenario: each gets the readings of the light's cycle over the
// first 10,000 steps. Of several lights before it, that is the first for its own turn (more than
// 30 degrees to a side) or for all, otherwise the first for going straight, otherwise the first.
// A lane that begins behind several lights has a signal of each, of which the most restrictive
// counts. The light of a lanelet without successors is left out.
//
// INVALID_ARGUMENT, with the element, if it is not XML or not a CommonRoad scenario, has another
// version, has no such obstacles, more of something than ScenarioLimits allow, or an element that
// is required is missing or wrong.
absl::StatusOr<v1::Scenario> ParseCommonRoad(std::string_view xml);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_COMMONROAD_COMMONROAD_READER_H_
