// Draws the actions that a model has learned over recorded trajectories.

#ifndef MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_
#define MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::plot {

// Draws the report's sampled examples as thin lines, each in the colour of its action, argmax
// q(y|x,s). Over them, a thick line shows the generic mean trajectory of each action, with its id
// at the end. Target frame, axes in metres at the same scale. The legend lists the actions by their
// mean p(y|s) in the report, with the label or, without one, the derived name. Leaves out actions
// that are neither effective nor the action of a sampled example. Eight colours that colour-blind
// people can distinguish are assigned so that neighbours differ. Returns a PNG file; the same input
// gives the same file. INVALID_ARGUMENT if there are no actions or no sampled examples, or a
// trajectory has unequal numbers of x and y.
absl::StatusOr<std::string> DrawActionMeans(const v1::ActionSet& actions,
                                            const v1::EvaluationReport& report);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_
