// Removes actions from a model.

#ifndef MANEUVER_MODEL_ARTIFACT_PRUNING_H_
#define MANEUVER_MODEL_ARTIFACT_PRUNING_H_

#include <span>

#include "absl/status/statusor.h"
#include "model/artifact/model_folder.h"

namespace maneuver::artifact {

// Returns the model with only the actions `kept`, renumbered from 0 in that order. p(y|s) and p(y)
// are renormalised over them; everything else about a kept action is unchanged. The manifest's
// actions and metrics are dropped, because they were measured on the whole model. INVALID_ARGUMENT
// if `kept` is invalid.
//   kept: at least two different actions of 0 .. K-1.
absl::StatusOr<StoredModel> PruneActions(const StoredModel& model, std::span<const int> kept);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_PRUNING_H_
