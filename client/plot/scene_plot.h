// Draws a scene with what its targets may do next.

#ifndef MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_
#define MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_

#include <string>

#include "absl/status/statusor.h"
#include "client/plot/scene_plot_options.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

// Draws one panel for each target of `prediction`, in the target's frame with its heading to the
// right, axes in metres:
//   - lanes grey, road edges and lines dim, areas faint, other agents red;
//   - the target bright, with its past, and in white what really happened, if the scenario says;
//   - each action in its own colour, its sigma trajectories thin and its mean thick.
// If the answer names representatives, only these are drawn like that, whatever their probability,
// numbered 1 .. k with their weights. The medoid, number 1, is thickest and ends in a white ring.
// Other actions then show only a thin mean.
//
// If the answer names joint combinations, the picture has a panel for each of them instead, at most
// nine, in the frame of the first target: what each target does in it, in a colour of its own, with
// a dot each second. `lane_paths` has no effect there.
//
// `lane_paths` adds the target's lane paths
// (model/scene/lane_paths.h) in turquoise, rings around the leaders on them, and marks at their
// signals and stop signs. Returns a PNG file; the same input gives the same file. INVALID_ARGUMENT
// if there is no target to draw, a trajectory has unequal numbers of x and y, or a side is not 200
// to 12000 pixels.
absl::StatusOr<std::string> DrawScene(const v1::Scenario& scenario,
                                      const v1::ScenarioPrediction& prediction,
                                      const ScenePlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_
