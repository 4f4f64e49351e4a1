// Draws how a scene changes the generic actions.

#ifndef MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_
#define MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "client/plot/scene_plot.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

// Draws the same scene twice at the same scale, as DrawScene does: on the left with the generic
// distributions p(z|y), on the right with the scene's own, q(z|y,s), both decoded. If the scene is
// wide, the second picture is below the first. The bands are the areas that the sigma trajectories
// sweep.
//   generic, posterior: the answers for LATENT_SOURCE_PRIOR and LATENT_SOURCE_POSTERIOR. The first
//     target that both answer is drawn.
// Returns a PNG file; the same input gives the same file. INVALID_ARGUMENT as in DrawScene.
absl::StatusOr<std::string> DrawGenericAndPosterior(const v1::Scenario& scenario,
                                                    const v1::ScenarioPrediction& generic,
                                                    const v1::ScenarioPrediction& posterior,
                                                    const ScenePlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_POSTERIOR_PLOT_H_
