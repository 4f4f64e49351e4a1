// What a scene makes of the generic actions, as a picture.

#ifndef MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_
#define MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "client/plot/scene_plot.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

// Draws the same scene twice at the same scale, as DrawScene does: at the left with the generic
// distributions p(z|y) decoded, at the right with those that the scene makes of them, q(z|y,s). One
// above the other where what has to be seen is wide. The bands are what the sigma trajectories
// sweep.
//   generic, posterior: the answers for LATENT_SOURCE_PRIOR and LATENT_SOURCE_POSTERIOR; the first
//     target that both answer is drawn.
// Returns a PNG file; the same for the same input. INVALID_ARGUMENT as DrawScene.
absl::StatusOr<std::string> DrawGenericAndPosterior(const v1::Scenario& scenario,
                                                    const v1::ScenarioPrediction& generic,
                                                    const v1::ScenarioPrediction& posterior,
                                                    const ScenePlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_
