// People on foot: they walk along footways and cross the road when it is clear.

#ifndef MANEUVER_MODEL_DATA_TOWN_PEDESTRIANS_H_
#define MANEUVER_MODEL_DATA_TOWN_PEDESTRIANS_H_

#include <span>
#include <vector>

#include "model/data/town/place.h"
#include "model/data/town/random.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

struct Pedestrian {
  int id = 0;
  int footway = 0;
  bool backwards = false;
  double s = 0.0;       // metres walked along the footway, in the direction of walking
  double pace = 1.35;   // desired, metres per second
  double speed = 0.0;   // metres per second
  double offset = 0.0;  // metres left of the footway's line
  bool on_road = false;
  Vec2 p;                // in the place's frame
  double heading = 0.0;  // radians, in the place's frame
};

class Pedestrians {
 public:
  Pedestrians(const Place& place, Random& random, int first_id);

  // Moves everyone from `time` by `dt` seconds, given the vehicles at `time` and what they have
  // ahead (LookAhead). Whoever reaches the end of the footway disappears.
  void Step(double time, double dt, std::span<const Vehicle> vehicles);
  std::span<const Pedestrian> all() const { return walkers_; }

 private:
  bool MayCross(const Pedestrian& walker, double time, std::span<const Vehicle> vehicles) const;
  void SetPose(Pedestrian& walker) const;

  const Place& place_;
  std::vector<Pedestrian> walkers_;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_PEDESTRIANS_H_
