// The actions that a model has learned over what was really driven, as a picture.

#ifndef MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_
#define MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::plot {

// Draws the report's sampled examples thin, each in the colour of its action, argmax q(y|x,s), and
// over them the generic mean trajectory of each action thick, with its id at its end. Target frame,
// axes in metres at the same scale. The legend lists the actions by their mean p(y|s) in the
// report, with the label or else the kinematic class that they were mostly used for. Actions that
// are neither effective nor any sampled example's are left out. Eight colours that colour-blind
// people tell apart are dealt out such that neighbours differ.
// Returns a PNG file; the same for the same input. INVALID_ARGUMENT if there are no actions or no
// sampled examples, or a trajectory has unequal numbers of x and y.
absl::StatusOr<std::string> DrawActionMeans(const v1::ActionSet& actions,
                                            const v1::EvaluationReport& report);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_ACTION_MEANS_PLOT_H_
