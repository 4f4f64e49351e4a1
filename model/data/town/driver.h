// How people drive: their wishes, and car-following by the intelligent driver model (Treiber,
// Hennecke, Helbing 2000).

#ifndef MANEUVER_MODEL_DATA_TOWN_DRIVER_H_
#define MANEUVER_MODEL_DATA_TOWN_DRIVER_H_

#include "model/data/town/random.h"

namespace maneuver::data::town {

struct Driver {
  double speed_factor = 1.0;     // of the speed limit
  double acceleration = 1.6;     // metres per second squared
  double braking = 2.0;          // comfortable, positive
  double headway = 1.3;          // seconds
  double standstill_gap = 2.0;   // metres
  double lateral_comfort = 2.4;  // sideways acceleration in curves, metres per second squared
  double patience = 4.5;         // gap in time taken when giving way, seconds
  double offset = 0.0;           // from the lane's centre, metres to the left
  double corner_cut = 0.0;       // metres towards the inside of a turn
  double wander = 0.15;          // amplitude of drifting within the lane, metres
  double wander_length = 120.0;  // period of the drifting, metres
  double wander_phase = 0.0;     // radians
  double change_time = 4.5;      // seconds that a lane change takes
};

Driver DrawDriver(Random& random);
Driver DrawCyclist(Random& random);

// Returns the acceleration that the model wants, metres per second squared. Speeds are in m/s.
//   desired_speed: > 0; leader_speed: along the follower's path.
//   gap: bumper to bumper, metres; infinity without a leader.
double IdmAcceleration(const Driver& driver, double speed, double desired_speed, double gap,
                       double leader_speed);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_DRIVER_H_
