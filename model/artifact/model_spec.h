// Rules for a ModelSpec, and the shapes that follow from it.

#ifndef MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_
#define MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/field_violation.h"

namespace maneuver::artifact {

// What is wrong with a complete spec (fields named from the spec: raster.height, ...).
std::vector<scene::FieldViolation> ValidateModelSpec(const v1::ModelSpec& spec);

// Time between two waypoints, and from the prediction time to the first one, seconds.
double WaypointInterval(const v1::TrajectorySpec& spec);
// Time of each waypoint after the prediction time, seconds. [T]
std::vector<double> WaypointTimes(const v1::TrajectorySpec& spec);

// F', what p(y|s) and q(z|y,s) read of a scene: the joint features of a model with scene vectors;
// else the backbone's features, then the target's motion if the model asks for it.
int64_t SceneFeatures(const v1::ModelSpec& spec);

// Whether the model has learned to predict agents of this type (ModelSpec.target_types). An agent
// whose type is not stated passes for one that it has learned.
bool Predicts(const v1::ModelSpec& spec, v1::AgentType type);
// The types that the model has learned, for people: "vehicles", "pedestrians and cyclists".
std::string TargetTypesText(const v1::ModelSpec& spec);
// One agent of a type, for people: "a pedestrian".
std::string AgentText(v1::AgentType type);

// Whether trajectories are relative to a roll-out of the present motion.
bool HasReference(const v1::ModelSpec& spec);
// Whether the model reads lane paths.
bool ReadsLanePaths(const v1::ModelSpec& spec);
// Whether the model reads the agents nearby as vectors.
bool ReadsAgents(const v1::ModelSpec& spec);

// The decoder's trajectories are cubic splines over the horizon that start at 0, with a knot about
// every kKnotInterval seconds: what a driver does takes no less.
inline constexpr double kKnotInterval = 0.8;
// M, the number of spline functions an axis; T where that is less.
int64_t CurveFunctions(const v1::TrajectorySpec& spec);

// Name and shape of every tensor of a model, as tensor.h lists them.
std::map<std::string, std::vector<int64_t>> TensorShapes(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_
