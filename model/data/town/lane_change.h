// Decides when vehicles change lanes, and how.

#ifndef MANEUVER_MODEL_DATA_TOWN_LANE_CHANGE_H_
#define MANEUVER_MODEL_DATA_TOWN_LANE_CHANGE_H_

#include <span>

#include "model/data/town/lane_network.h"
#include "model/data/town/random.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

// Draws a random route of at most 40 lanes. It begins on `lane` at arc length `from` (metres) and
// ends where the lanes do.
std::vector<RouteStep> DrawRoute(const LaneNetwork& graph, int lane, double from, Random& random);

// Begins a lane change if `vehicle` wants one and finds a gap for it.
//   leader_gap, leader_speed: of the vehicle ahead, metres and m/s; infinite gap without one.
//   time: seconds.  rate: wishes per second.
void ConsiderLaneChange(const LaneNetwork& graph, std::span<const Vehicle> vehicles, double time,
                        double rate, double leader_gap, double leader_speed, Random& random,
                        Vehicle& vehicle);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_LANE_CHANGE_H_
