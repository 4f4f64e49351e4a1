// Simulates the traffic of one place, step by step.

#ifndef MANEUVER_MODEL_DATA_TOWN_TRAFFIC_H_
#define MANEUVER_MODEL_DATA_TOWN_TRAFFIC_H_

#include <vector>

#include "model/data/town/pedestrians.h"
#include "model/data/town/place.h"
#include "model/data/town/random.h"
#include "model/data/town/track.h"
#include "model/data/town/vehicle.h"

namespace maneuver::data::town {

struct TrafficOptions {
  double duration = 20.0;       // seconds
  double frame_interval = 0.1;  // seconds
};

// Returns everyone's motion from time 0 to `duration`, in the place's frame, without noise. A track
// has a point for each frame in which its owner is there; those with only one are left out. The
// traffic has run for Place::warm_up before time 0.
std::vector<Track> SimulateTraffic(const Place& place, const TrafficOptions& options,
                                   Random& random);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TRAFFIC_H_
