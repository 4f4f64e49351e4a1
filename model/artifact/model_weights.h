// Checks weights against a spec.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_

#include <string>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"

namespace maneuver::artifact {

// Returns the first fault of the weights of a valid spec; empty if there is none. Faults are: a
// tensor is missing, unknown or of another shape; a value is not finite; a standard deviation is
// not positive; a variance, or a factor of one, is negative; a covariance is not positive
// semi-definite.
std::string FindWeightFault(const v1::ModelSpec& spec, const TensorMap& weights);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_WEIGHTS_H_
