// Labels what the vehicles of a recording do.
//
// Each name describes something that shows in four or five seconds of a trajectory:
//   keep_lane            along a lane that hardly bends, at the speed of town traffic
//   creep                the same, slower than 6 m/s over four seconds: queues, aisles, approaches
//   cruise               the same, faster than 17 m/s: motorways
//   follow_curve_left    along a lane that bends by more than about 14 degrees within four seconds
//   follow_curve_right
//   turn_left            through a junction, from just before it until straight again
//   turn_right
//   u_turn               the same, by 180 degrees
//   roundabout           from the entry to the end of the exit
//   lane_change_left     from the first to the last sideways movement
//   lane_change_right
//   merge                a lane change out of an on-ramp that ends
//   park_out             out of a parking bay, until under way
//   stop                 slowing down to a standstill, for any reason
//   standing             at a standstill (slower than 0.6 m/s): parked, or waiting
//   start                from a standstill until most of the speed is reached
// If several apply, the first of this order wins: standing; a manoeuvre of the route that has begun
// (but a stop within a lane change is a stop); stop; a manoeuvre that is about to begin; start;
// curves; the ways of keeping the lane. An interval shorter than 0.8 s is merged into the previous
// one, the first into the next.

#ifndef MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_
#define MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_

#include <span>
#include <string_view>
#include <vector>

#include "model/data/town/track.h"

namespace maneuver::data::town {

// Returns a manoeuvre's name. The names are in the order of `Maneuver`.
std::string_view ManeuverName(Maneuver maneuver);
inline constexpr int kManeuverCount = 16;

struct ManeuverInterval {
  Maneuver maneuver = Maneuver::kKeepLane;
  double start = 0.0;  // seconds
  double end = 0.0;
};

// Returns consecutive intervals without gaps, from the track's first point to its last.
std::vector<ManeuverInterval> RecordManeuvers(const Track& track);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_
