// What a model costs, counted from its sizes.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_

#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/model_spec.pb.h"

namespace maneuver::artifact {

// Returns the cost of a model with a valid spec. Counted as is usual for image networks:
// convolutions, fully connected layers and the weighted sums of attention alone multiply; a batch
// normalisation has two parameters a channel, its running moments are none.
v1::ModelCost CountCost(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_COST_H_
