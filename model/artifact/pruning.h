// A model without some of its actions.

#ifndef MANEUVER_MODEL_ARTIFACT_PRUNING_H_
#define MANEUVER_MODEL_ARTIFACT_PRUNING_H_

#include <span>

#include "absl/status/statusor.h"
#include "model/artifact/model_folder.h"

namespace maneuver::artifact {

// The model with the actions `kept` alone, renumbered from 0 in that order. p(y|s) and p(y) are
// what they were, renormalised over them; all else of a kept action stays as it was. The manifest's
// actions and metrics, which were measured on the whole, are left out.
//   kept: at least two different ones of 0 .. K-1
// INVALID_ARGUMENT if they are not.
absl::StatusOr<StoredModel> PruneActions(const StoredModel& model, std::span<const int> kept);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_PRUNING_H_
