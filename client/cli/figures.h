// Draws the figures of an evaluation.

#ifndef MANEUVER_CLIENT_CLI_FIGURES_H_
#define MANEUVER_CLIENT_CLI_FIGURES_H_

#include <string>

#include "absl/status/status.h"
#include "client/cli/environment.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

// The value of EvaluateRequest.sampled_examples that the figures require.
inline constexpr int kSampledExamples = 500;

// Creates the folder for figures if it is missing, and checks that files can be created in it.
// FAILED_PRECONDITION names the folder and the reason.
absl::Status PrepareFigureFolder(const std::string& folder);

// Draws these pictures into `folder`, which is created if it is missing:
//   actions.png       each effective action's mean with its sigma trajectories; if actions depend on
//                     the speed, all means at each of several speeds
//   action-means.png  the means over the report's sampled examples
//   reliability.png   p(y|s) against q(y|x,s)
//   scene-left.png, scene-right.png, scene-far.png, scene-open.png
//                     generic and posterior distributions in four of the sampled scenes: where the
//                     target ends furthest to the left, to the right and ahead, and where p(y|s)
//                     has the largest entropy. Each is of another recording. None is chosen by its
//                     error.
// Action set, recordings and predictions come from the server. Returns kOk if all were drawn.
int DrawFigures(const v1::EvaluationReport& report, const std::string& folder,
                Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_FIGURES_H_
