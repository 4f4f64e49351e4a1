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

// Returns what is wrong with a complete spec. Field paths start at the spec: raster.height, ...
std::vector<scene::FieldViolation> ValidateModelSpec(const v1::ModelSpec& spec);

// Returns the time between two waypoints, seconds. It is the first of WaypointTimes.
double WaypointInterval(const v1::TrajectorySpec& spec);
// Returns the time of each waypoint after the prediction time, [T] seconds.
std::vector<double> WaypointTimes(const v1::TrajectorySpec& spec);

// Returns F', the number of scene features that p(y|s) and q(z|y,s) read: for a model with scene
// vectors its joint features, otherwise the backbone's features, plus the target's motion if the
// model reads it.
int64_t SceneFeatureCount(const v1::ModelSpec& spec);

// Returns whether the model has learned to predict agents of this type (ModelSpec.target_types). An
// unspecified type counts as learned.
bool Predicts(const v1::ModelSpec& spec, v1::AgentType type);
// Returns the types that the model has learned, for people: "vehicles", "pedestrians and cyclists".
std::string TargetTypesText(const v1::ModelSpec& spec);
// Returns one agent of a type, for people: "a pedestrian".
std::string AgentText(v1::AgentType type);

// Returns whether trajectories are relative to a roll-out of the present motion.
bool HasReference(const v1::ModelSpec& spec);
// Returns whether the model reads lane paths.
bool ReadsLanePaths(const v1::ModelSpec& spec);
// Returns whether the model reads nearby agents as vectors.
bool ReadsAgents(const v1::ModelSpec& spec);

// The decoder's trajectories are cubic splines over the horizon that start at 0, with a knot about
// every kKnotInterval seconds. No manoeuvre takes less time.
inline constexpr double kKnotInterval = 0.8;
// Returns M, the number of spline functions per axis; at most T.
int64_t CurveFunctions(const v1::TrajectorySpec& spec);

// Returns the name of a perceptron's last layer, "decoder.3". Its tensors are named this followed
// by ".weight" and ".bias".
std::string LastLayer(const std::string& network, const v1::MlpSpec& mlp);
// Returns the name and shape of every tensor of a model, as in tensor.h.
std::map<std::string, std::vector<int64_t>> TensorShapes(const v1::ModelSpec& spec);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_MODEL_SPEC_H_
