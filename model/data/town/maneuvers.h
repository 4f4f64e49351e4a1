// What vehicles are recorded as doing.
//
// Names are chosen so that what they name can be seen in four or five seconds of a trajectory:
//   keep_lane            along a lane that does not bend much, at a town's speed
//   creep                likewise, slower than 6 m/s over four seconds: queues, aisles, approaches
//   cruise               likewise, faster than 17 m/s: motorways
//   follow_curve_left    along a lane that bends by more than about 14 degrees within four seconds
//   follow_curve_right
//   turn_left            through a junction, from just before it until straight again
//   turn_right
//   u_turn               likewise, by 180 degrees
//   roundabout           from the entry to the end of the exit
//   lane_change_left     from the first to the last sideways movement
//   lane_change_right
//   merge                a lane change out of an on-ramp that ends
//   park_out             out of a parking bay and on until under way
//   stop                 slowing down to a standstill, whatever for
//   standing             at a standstill (slower than 0.6 m/s): parked, or waiting
//   start                from a standstill until most of the speed is reached
// Where two would hold: standing comes first; then what the route has in store, once begun (but a
// stop within a lane change is a stop); then stop, start, curves, and the ways of keeping the lane
// last. Intervals shorter than 0.8 s belong to what was before them.

#ifndef MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_
#define MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_

#include <span>
#include <string_view>
#include <vector>

#include "model/data/town/track.h"

namespace maneuver::data::town {

// All names, in the order of `Maneuver`.
std::string_view ManeuverName(Maneuver maneuver);
inline constexpr int kManeuverCount = 16;

struct ManeuverInterval {
  Maneuver maneuver = Maneuver::kKeepLane;
  double start = 0.0;  // seconds
  double end = 0.0;
};

// Intervals that follow each other without a gap from the track's first to its last point.
std::vector<ManeuverInterval> RecordManeuvers(const Track& track);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_MANEUVERS_H_
