// The true motion of one road user, before any sensor observes it.

#ifndef MANEUVER_MODEL_DATA_TOWN_TRACK_H_
#define MANEUVER_MODEL_DATA_TOWN_TRACK_H_

#include <vector>

#include "model/data/town/path.h"

namespace maneuver::data::town {

enum class Maneuver {
  kKeepLane,
  kCreep,
  kCruise,
  kFollowCurveLeft,
  kFollowCurveRight,
  kTurnLeft,
  kTurnRight,
  kUTurn,
  kRoundabout,
  kLaneChangeLeft,
  kLaneChangeRight,
  kMerge,
  kParkOut,
  kStop,
  kStanding,
  kStart,
};

enum class RoadUser { kVehicle, kPedestrian, kCyclist };

struct TrackPoint {
  double time = 0.0;          // seconds
  Vec2 p = {};                // centre of the box
  double heading = 0.0;       // of the body, radians, not wrapped
  Vec2 velocity = {};         // metres per second
  double speed = 0.0;         // length of velocity, metres per second
  double travelled = 0.0;     // metres since the road user appeared
  double path_heading = 0.0;  // of the lane in the direction of travel, radians
  double lateral = 0.0;       // metres left of the lane's centre
  int lane = -1;              // index of the place's lane; -1 off the lanes
};

// A manoeuvre that the route contains, between two distances travelled, metres.
struct RouteEvent {
  Maneuver maneuver = Maneuver::kKeepLane;
  double lead = 0.0;  // where the approach begins
  double from = 0.0;  // where the manoeuvre itself begins
  double to = 0.0;    // where it ends
};

struct Track {
  int id = 0;
  RoadUser kind = RoadUser::kVehicle;
  double length = 4.6;  // metres
  double width = 1.85;  // metres
  std::vector<TrackPoint> points;
  std::vector<RouteEvent> events;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TRACK_H_
