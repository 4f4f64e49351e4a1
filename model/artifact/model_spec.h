// Rules for a ModelSpec, and the shapes that follow from it.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::artifact {

// What is wrong with a complete spec (fields named from the spec: raster.height, ...).
std::vector<scene::FieldViolation> ValidateModelSpec(const v1::ModelSpec& spec);

// Time of each waypoint after the prediction time, seconds. [T]
std::vector<double> WaypointTimes(const v1::TrajectorySpec& spec);

// F', what p(y|s) and q(z|y,s) read of a scene: the backbone's features, then the target's motion
// if the model asks for it.
int64_t SceneFeatures(const v1::ModelSpec& spec);

// Name and shape of every tensor of a model, as tensor.h lists them.
std::map<std::string, std::vector<int64_t>> TensorShapes(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_
