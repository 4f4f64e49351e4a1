// Private to plot/: the combinations of a scene's actions, one panel each.

#ifndef MANEUVER_CLIENT_PLOT_JOINT_PANELS_H_
#define MANEUVER_CLIENT_PLOT_JOINT_PANELS_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/scene_layers.h"
#include "client/plot/scene_plot_options.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::plot {

inline constexpr int kMostJointPanels = 9;  // the most probable combinations

// Keeps references to what its constructor is given. Call Prepare before the others.
class JointPanels {
 public:
  JointPanels(const v1::Scenario& scenario, const v1::ScenarioPrediction& prediction,
              const ScenePlotOptions& options)
      : scenario_(scenario), prediction_(prediction), options_(options) {}

  // Reads the trajectories of the combinations. INVALID_ARGUMENT if one is missing or has unequal
  // numbers of x and y, or if no target is visible.
  absl::Status Prepare();

  int size() const { return static_cast<int>(panels_.size()); }
  // Draws panel `index`, counted from 0, in the frame of the first target. All panels show the same
  // place at the same scale.
  void Draw(int index, const Box& cell, Canvas* canvas) const;

 private:
  // What one target does in one combination.
  struct Part {
    const v1::Agent* agent;
    size_t number = 0;  // among the targets of the combinations, which chooses its colour
    int action = 0;
    std::vector<scene::Point2> mean = {};  // from where it is now, world, metres
  };
  struct Panel {
    double weight = 0.0;
    std::vector<Part> parts = {};
  };

  absl::Status Read(int target, int action, Part* part) const;
  Extent Shown() const;
  std::string NameOf(const Part& part) const;
  Box LegendBox(const Panel& panel, const ScenePanel& scene) const;
  void DrawLegend(const Panel& panel, const Box& frame, Canvas* canvas) const;

  const v1::Scenario& scenario_;
  const v1::ScenarioPrediction& prediction_;
  const ScenePlotOptions& options_;
  scene::Pose2 X_WT_;  // of the first target that is visible
  std::vector<Panel> panels_;
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_JOINT_PANELS_H_
