// The synthetic town: generates scenes that resemble driving, reproducible by seed.

#ifndef MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_
#define MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_

#include "model/data/town/town_recording.h"

namespace maneuver::data::town {

// Generates recording number `index` of the town. It depends on options and index alone, not on
// what else was generated. Ids are "town-<seed>-<index>". Thread-safe.
TownRecording GenerateRecording(const TownOptions& options, int index);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SYNTHETIC_TOWN_H_
