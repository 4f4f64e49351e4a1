// Counts what a model costs, from its sizes.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_

#include <cstdint>

#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/model_spec.pb.h"

namespace maneuver::artifact {

// Returns the cost of a model with a valid spec, counted as usual for image networks: only
// convolutions, fully connected layers and the weighted sums of attention count as multiplications.
// A batch normalisation has two parameters per channel; its running moments do not count.
v1::ModelCost CountCost(const v1::ModelSpec& spec);

// Returns the bytes of memory that the predictions of all actions take for one example while a
// model is calibrated.
int64_t PredictionBytes(const v1::ModelSpec& spec);

// Returns about how many bytes of memory one example of a batch takes while the networks learn from
// it: its inputs, and what each layer computes.
int64_t ExampleBytes(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_
