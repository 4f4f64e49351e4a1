// Chooses the moment of a recording to predict from, and the targets.

#ifndef MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
#define MANEUVER_MODEL_DATA_TOWN_TARGETS_H_

#include "model/data/town/town_recording.h"

namespace maneuver::data::town {

// Sets prediction_time and target_ids. A vehicle may be a target if it has been visible for a
// second and moves at least 3 m in the next four. It is the more interesting, the more it does
// besides keeping its lane in the next five seconds, and the less so, the sooner it disappears. The
// targets are the up to four most interesting vehicles of the moment at which these are most
// interesting together, of moments half a second apart, at least a second after the start and where
// possible eight seconds before the end. There may be none.
void ChooseTargets(const TownOptions& options, TownRecording& recording);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
