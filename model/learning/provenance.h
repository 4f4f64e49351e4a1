// Where a model comes from, for its manifest.

#ifndef MANEUVER_MODEL_LEARNING_PROVENANCE_H_
#define MANEUVER_MODEL_LEARNING_PROVENANCE_H_

#include <string>
#include <vector>

#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// Returns the provenance of a model that is made now.
//   dataset_names: as people know them, of `data`
//   start_from: name of the version that it starts from; empty: none
v1::Provenance MakeProvenance(const v1::TrainingSettings& settings, const TrainingData& data,
                              const std::vector<std::string>& dataset_names,
                              const std::string& start_from, const std::string& trainer_version);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_PROVENANCE_H_
