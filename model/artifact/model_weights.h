// Whether weights are those of a spec.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_

#include <string>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"

namespace maneuver::artifact {

// The first thing that is wrong with the weights of a valid spec, empty if nothing is: a tensor is
// missing, unknown or of another shape, a value is not finite, a standard deviation not positive, a
// variance negative, a covariance not positive semi-definite.
std::string FindWeightFault(const v1::ModelSpec& spec, const TensorMap& weights);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_
