// Measures whether two models, of two training seeds for instance, have found the same actions.

#ifndef MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_H_
#define MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_H_

#include <Eigen/Core>

#include "absl/status/statusor.h"
#include "maneuver/v1/action_matching.pb.h"
#include "maneuver/v1/model.pb.h"

namespace maneuver::evaluation {

// Pairs the effective actions of two models one to one. The distance of actions i and j is the
// average displacement of their generic mean trajectories, p(z|y) decoded,
//
//   d(i, j) = 1/T sum_t |mu_i(t) - nu_j(t)|   metres,
//
// which is the ADE of motion forecasting between two predictions. A 2-Wasserstein distance would
// also compare the widths of the generic distributions. It is not used: the widths are fitted to
// each model's own errors, and a pair should be close when the vehicles are.
//
// Let p_i be the share of action i, its mean p(y|s). The pairs minimise
//
//   sum over pairs of w d,  w = (p_i + p_j) / 2   (assignment.h),
//
// so that rare actions do not separate frequent ones. An action without a partner (the other model
// has fewer) costs p / 2 times the largest of all d. The result also contains
//   mean_distance   sum w d / sum w, metres, over the pairs
//   tolerance       kToleranceSpeed times the horizon: 2 m at 5 s
//   agreeing_share  for each model, the sum of its shares over the pairs with d <= tolerance, from
//                   0 to 1
//
// Shares come from the manifests (validation examples). For models whose actions are relative to
// the present motion, the generic means are those that the manifests store, at 10 m/s.
// INVALID_ARGUMENT if a manifest has no effective action, or one whose mean trajectory lacks
// waypoints; if the models' waypoints are at different times; or if only one model has a reference.
absl::StatusOr<v1::ActionMatching> MatchActions(const v1::ModelManifest& first,
                                                const v1::ModelManifest& second);

// Does the same with the given shares, [K] each, in place of those in the manifests.
absl::StatusOr<v1::ActionMatching> MatchActions(const v1::ModelManifest& first,
                                                const Eigen::VectorXd& first_shares,
                                                const v1::ModelManifest& second,
                                                const Eigen::VectorXd& second_shares);

inline constexpr double kToleranceSpeed = 0.4;  // m/s

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ACTION_MATCHING_H_
