// A vehicle (or bicycle) on its route through the lanes.
//
// The vehicle follows a path that its lanes and its driver's habits determine: the centreline, plus
// an offset to the left that depends only on the distance travelled, so that a standing vehicle
// keeps its pose. The centre of the box follows the path. The body's heading follows like that of a
// vehicle with a fixed rear axle.

#ifndef MANEUVER_MODEL_DATA_TOWN_VEHICLE_H_
#define MANEUVER_MODEL_DATA_TOWN_VEHICLE_H_

#include <limits>
#include <vector>

#include "model/data/town/driver.h"
#include "model/data/town/lane_network.h"
#include "model/data/town/track.h"

namespace maneuver::data::town {

struct RouteStep {
  int lane = 0;
  double from = 0.0;  // arc length at which the lane is joined, metres
};

// A point of the path ahead of a vehicle's centre.
struct AheadPoint {
  double distance = 0.0;  // metres
  Vec2 p;
  Vec2 direction;
  double speed_limit = 0.0;  // m/s; from the lane, the driver and the curvature
};

// Lengths are in metres, speeds in m/s, times in seconds, angles in radians.
struct Vehicle {
  int id = 0;
  RoadUser kind = RoadUser::kVehicle;
  double length = 4.6;
  double width = 1.85;
  Driver driver;

  std::vector<RouteStep> route;
  size_t step = 0;  // of the route
  double s = 0.0;   // arc length on its lane
  double travelled = 0.0;
  double speed = 0.0;
  double acceleration = 0.0;  // m/s^2
  PathPoint pose;             // centre; heading and curvature of the path driven
  double lateral = 0.0;       // distance left of the lane's centre
  double body_heading = 0.0;

  // A lane change: an offset that fades from `change_offset` to 0.
  double change_start = -1e9;  // distance travelled
  double change_length = 1.0;
  double change_offset = 0.0;
  double wishes_at = 0.0;  // time of the next wish to change lanes

  // The last step of the route that the gates let it enter.
  size_t admitted = 0;
  // When it first stopped at the stop line ahead; infinity before.
  double stood_at = std::numeric_limits<double>::infinity();
  double leaves_at = -1e9;  // time until which it stays in its bay

  std::vector<RouteEvent> events;

  std::vector<AheadPoint> ahead;
  double looked_at = -1.0;  // distance travelled when `ahead` was last set

  int lane() const { return route[step].lane; }
  bool changing() const { return travelled < change_start + change_length; }
};

// The offset from the lane's centre.
struct Lateral {
  double offset = 0.0;  // metres to the left
  double slope = 0.0;   // change of the offset per metre
};
// Returns the offset at arc length `s` of a lane, where the vehicle will have driven `travelled`
// metres.
Lateral LateralAt(const Vehicle& vehicle, const Lane& lane, double s, double travelled);

// Returns the pose on the path driven, at the same place as LateralAt.
PathPoint PoseAt(const Vehicle& vehicle, const Lane& lane, double s, double travelled);

// Sets `ahead`: the path every two metres, as far as matters at the present speed.
void LookAhead(const LaneNetwork& graph, Vehicle& vehicle);

// Returns the distance from the centre to the start of step `step` of the route, metres.
double DistanceToStep(const LaneNetwork& graph, const Vehicle& vehicle, size_t step);

// Moves by a time step of `dt` seconds at the present speed and acceleration. Returns false when
// the route has ended.
bool Advance(const LaneNetwork& graph, double dt, Vehicle& vehicle);

// Sets pose and lateral offset from the route, and the body's heading too if `align`.
void SetPose(const LaneNetwork& graph, bool align, Vehicle& vehicle);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_VEHICLE_H_
