// A scene with what its targets may do next, as a picture.

#ifndef MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_
#define MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_

#include <map>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

struct ScenePlotOptions {
  // Pixels; 0: by the number of targets.
  int width = 0;
  int height = 0;
  // Distributions of actions less probable than this are not drawn, but for representatives.
  double min_probability = 0.05;
  // Frame of the trajectories in the answer, as asked for in DistributionQuery.frame.
  v1::Frame frame = v1::FRAME_WORLD;
  // Truth is drawn as far as this after the prediction time, seconds; 0: as far as it is known.
  double horizon = 0.0;
  bool lane_paths = false;                 // draw where each target can go along the lanes
  std::string model_version = "";          // for the title; may be empty
  std::map<int, std::string> labels = {};  // names of actions, by id
};

// Draws one panel for each target of `prediction`, in the target's frame with its heading to the
// right, axes in metres: lanes grey, road edges and lines dim, areas faint, other agents red, the
// target bright with its past, each action in a colour of its own with its sigma trajectories thin
// and its mean thick, and what really happened white, if the scenario says. Where the answer names
// representatives, these are drawn so, whatever their probability, and numbered 1 .. k with their
// weights; the medoid, number 1, is the thickest and its end has a white ring; of other actions the
// means alone are drawn, thin. With `lane_paths`, the target's lane paths
// (model/scene/lane_paths.h) turquoise, the leaders on them ringed, and the signals and stop signs
// that they meet marked. Returns a PNG file; the same for the same input. INVALID_ARGUMENT if there
// is no target to draw, a trajectory has unequal numbers of x and y, or the size is out of range.
absl::StatusOr<std::string> DrawScene(const v1::Scenario& scenario,
                                      const v1::ScenarioPrediction& prediction,
                                      const ScenePlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_SCENE_PLOT_H_
