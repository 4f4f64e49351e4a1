// What to show of a scene.

#ifndef MANEUVER_CLIENT_PLOT_SCENE_PLOT_OPTIONS_H_
#define MANEUVER_CLIENT_PLOT_SCENE_PLOT_OPTIONS_H_

#include <map>
#include <string>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::plot {

struct ScenePlotOptions {
  // Pixels; 0: chosen by the number of targets, at most 12000. The panels of more than 144 targets
  // become smaller.
  int width = 0;
  int height = 0;
  // Hides the distributions of less probable actions, except representatives.
  double min_probability = 0.05;
  // Frame of the trajectories in the answer, as asked for in DistributionQuery.frame.
  v1::Frame frame = v1::FRAME_WORLD;
  // How far the truth is drawn after the prediction time, seconds; 0: as far as it is known.
  double horizon = 0.0;
  bool lane_paths = false;                 // draws each target's lane paths
  std::string model_version = "";          // for the title; may be empty
  std::map<int, std::string> labels = {};  // names of actions, by id
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_SCENE_PLOT_OPTIONS_H_
