// The figures of an evaluation.

#ifndef MANEUVER_CLIENT_CLI_FIGURES_H_
#define MANEUVER_CLIENT_CLI_FIGURES_H_

#include <string>

#include "absl/status/status.h"
#include "client/cli/environment.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

// What EvaluateRequest.sampled_examples has to be for figures.
inline constexpr int kSampledExamples = 500;

// Makes the folder for figures if it is not there, and sees whether files can be made in it.
// FAILED_PRECONDITION names the folder and the reason.
absl::Status PrepareFigureFolder(const std::string& folder);

// Draws into `folder`, which is made if it is not there:
//   actions.png       each effective action's mean with its sigma trajectories
//   action-means.png  the means over the report's sampled examples
//   reliability.png   p(y|s) against q(y|x,s)
//   scene-left.png, scene-right.png, scene-far.png, scene-open.png
//                     generic against posterior distributions in four of the sampled scenes: where
//                     the target went furthest to the left, to the right, furthest in all, and
//                     where p(y|s) was the most open. None is chosen by how well it was predicted.
// Action set, recordings and predictions come from the server. Returns kOk if all were drawn.
int DrawFigures(const v1::EvaluationReport& report, const std::string& folder,
                Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_FIGURES_H_
