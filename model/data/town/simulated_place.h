// A recording before any sensor observes it. Tests check the town's physics on it.

#ifndef MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_
#define MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_

#include <vector>

#include "model/data/town/place.h"
#include "model/data/town/town_recording.h"
#include "model/data/town/track.h"

namespace maneuver::data::town {

// The depth to which the boxes of two road users may overlap, metres. Vehicles that cut the corners
// of a car park come this close. A place with deeper overlaps is drawn again.
inline constexpr double kOverlapTolerance = 0.1;
// The least number of agents that the sensor sees. Places with fewer are drawn again.
inline constexpr int kFewestAgents = 15;

struct SimulatedPlace {
  Place place;
  std::vector<Track> tracks;
};

// Returns the noiseless tracks behind GenerateRecording(options, index), in the place's frame.
// Draws a place at most twelve times, and keeps the best if none is good enough.
SimulatedPlace SimulatePlace(const TownOptions& options, int index);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_
