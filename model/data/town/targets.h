// Which moment of a recording to ask about, and for whom.

#ifndef MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
#define MANEUVER_MODEL_DATA_TOWN_TARGETS_H_

#include "model/data/town/synthetic_town.h"

namespace maneuver::data::town {

// Sets prediction_time and target_ids: the moment, at least a second in and with up to eight
// seconds to come, at which most vehicles are about to do something other than keeping their lane;
// and up to four of those who are seen then and move in the following seconds.
void ChooseTargets(const TownOptions& options, TownRecording& recording);

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_TARGETS_H_
