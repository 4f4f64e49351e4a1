// What vehicles are recorded as doing.
//
// Names are chosen so that what they name can be seen in four or five seconds of a trajectory:
//   keep_lane            along a lane that does not bend much, moving
//   follow_curve_left    along a lane that bends by more than about 14 degrees within four seconds
//   follow_curve_right
//   turn_left            through a junction, from a few metres before the stop line until straight
//   turn_right
//   u_turn               likewise, by 180 degrees
//   roundabout           from the entry to the end of the exit
//   lane_change_left     from the first to the last sideways movement
//   lane_change_right
//   merge                a lane change out of an on-ramp that ends
//   park_out             out of a parking bay and on until under way
//   stop                 slowing down to a standstill, whatever for
//   standing             at a standstill: parked, or waiting
//   start                from a standstill until most of the speed is reached
// Where two would hold, standing comes first, then park_out, u_turn and turns (once begun), stop,
// start, and keep_lane last.

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
