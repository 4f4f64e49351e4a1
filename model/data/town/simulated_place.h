// A recording before any sensor looked at it: what tests hold the town's physics against.

#ifndef MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_
#define MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_

#include <vector>

#include "model/data/town/place.h"
#include "model/data/town/synthetic_town.h"
#include "model/data/town/track.h"

namespace maneuver::data::town {

// How deep, in metres, boxes may reach into each other: a car park's corners are cut as closely as
// that. A place whose traffic does worse is drawn again.
inline constexpr double kOverlapTolerance = 0.1;
// How many are about at least; emptier places are drawn again too.
inline constexpr int kFewestAgents = 15;

struct SimulatedPlace {
  Place place;
  std::vector<Track> tracks;
};

// The noiseless tracks behind GenerateRecording(options, index), in the place's frame.
SimulatedPlace SimulatePlace(const TownOptions& options, int index);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SIMULATED_PLACE_H_
