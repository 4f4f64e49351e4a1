// Finds who is ahead of a vehicle.

#ifndef MANEUVER_MODEL_DATA_TOWN_LEADER_H_
#define MANEUVER_MODEL_DATA_TOWN_LEADER_H_

#include <limits>
#include <span>

#include "model/data/town/pedestrians.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

struct Leader {
  double gap = std::numeric_limits<double>::infinity();  // metres between bumpers
  double speed = 0.0;                                    // along the follower's path, m/s
};

// Returns the first road user in the way on the path ahead of `vehicle`. Found by geometry alone:
// the lane of the other does not matter. Pedestrians count while they are on the road.
Leader FindLeader(std::span<const Vehicle> vehicles, std::span<const Pedestrian> walkers,
                  const Vehicle& vehicle);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_LEADER_H_
