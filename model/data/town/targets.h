// Chooses the moment of a recording to predict from, and the targets.

#ifndef MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
#define MANEUVER_MODEL_DATA_TOWN_TARGETS_H_

#include "model/data/town/town_recording.h"

namespace maneuver::data::town {

// Sets prediction_time and target_ids. The moment is at least a second after the start, and where
// possible eight seconds before the end. Of these, it is the one at which most vehicles are about to
// do something other than keeping their lane. The targets are up to four vehicles that are visible
// then and move in the following seconds.
void ChooseTargets(const TownOptions& options, TownRecording& recording);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
