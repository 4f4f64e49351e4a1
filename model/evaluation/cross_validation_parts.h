// Merges the parts of one cross-validation.

#ifndef MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_PARTS_H_
#define MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_PARTS_H_

#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/cross_validation.pb.h"

namespace maneuver::evaluation {

// Returns whether two plans learn with the same settings and divide the same recordings of the same
// datasets in the same way. Their seeds may differ, and what they call the datasets: machines may
// call them differently, and plans of older programs do not name them.
bool SamePlan(v1::CrossValidationPlan a, v1::CrossValidationPlan b);

// Returns one part with all runs, ordered by seed, then by fold. Also checks that the figures are
// honest: no model was measured on a recording of a group that it learned from.
// INVALID_ARGUMENT without parts. FAILED_PRECONDITION, with what to do, if the parts have different
// plans (SamePlan) or no run at all, two of them have the same run, a seed lacks a fold, the
// seeds measured different numbers of examples, or only some runs have baselines. DATA_LOSS if a
// part contradicts itself.
absl::StatusOr<v1::CrossValidationPart> MergeParts(std::vector<v1::CrossValidationPart> parts);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CROSS_VALIDATION_PARTS_H_
