// Private to plot/: one target in its scene, with what it may do next.

#ifndef MANEUVER_CLIENT_PLOT_TARGET_PANEL_H_
#define MANEUVER_CLIENT_PLOT_TARGET_PANEL_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/scene_layers.h"
#include "client/plot/scene_plot_options.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/lane_paths.h"
#include "model/scene/pose2.h"

namespace maneuver::plot {

// Returns the agent if the scenario has it and it is visible at the prediction time; otherwise
// null.
const v1::Agent* AgentInSight(const v1::Scenario& scenario, int64_t agent_id);

// Keeps references to what its constructor is given. Call Prepare before Shown and Draw.
class TargetPanel {
 public:
  struct Style {
    std::string title = "";  // empty: scenario, target and time, with the model at the right
    bool legend = true;
  };

  //   target: must be visible at the prediction time
  TargetPanel(const v1::Scenario& scenario, const v1::Agent& target,
              const v1::TargetPrediction& prediction, const ScenePlotOptions& options);

  // Finds the lane paths to draw. Without this call, none are drawn.
  void FindLanePaths(const scene::LaneGraph& lanes);

  // Reads the trajectories. INVALID_ARGUMENT if one has unequal numbers of x and y.
  absl::Status Prepare();

  // Returns the extent to show, target frame: the target, what it may do and did, and its lane
  // paths unless actions are drawn.
  Extent Shown() const;

  void Draw(const Box& cell, const Extent& shown, const Style& style, Canvas* canvas) const;

 private:
  // The trajectories of one action, target frame, metres.
  struct ActionLines {
    const v1::ActionDistribution* distribution;
    int rank = 0;        // among the representatives, 1 is the medoid; 0: none
    double share = 0.0;  // probability, or the weight as a representative
    std::vector<std::vector<scene::Point2>> sigma = {};
    std::vector<scene::Point2> mean = {};
  };

  absl::Status Read(const v1::Trajectory& trajectory, std::vector<scene::Point2>* points) const;
  // Returns whether the answer names representatives. If so, these are drawn in full and other
  // actions faintly.
  bool HasRepresentatives() const { return !prediction_.representatives().empty(); }
  bool IsFaint(const ActionLines& action) const { return HasRepresentatives() && action.rank == 0; }
  // Returns the number of an action in the picture: its rank as a representative, otherwise its id.
  int NumberOf(const ActionLines& action) const;
  // Returns what the legend says about an action beside its number; may be empty.
  std::string NameOf(const ActionLines& action) const;
  // A line of the legend for anything but an action.
  struct Key {
    Color color;
    double width;
    std::string text;
  };
  std::vector<Key> Keys(bool truth) const;
  size_t LegendActions() const;
  // Returns the points of a lane path in the target's frame.
  std::vector<scene::Point2> InTarget(const scene::LanePath& path) const;
  void DrawSigma(const ScenePanel& panel, const ActionLines& action, Canvas* canvas) const;
  void DrawMean(const ScenePanel& panel, const ActionLines& action, Canvas* canvas) const;
  void DrawIds(const ScenePanel& panel, const Box& legend, const Line& truth, Canvas* canvas) const;
  Box LegendBox(const ScenePanel& panel, const Line& truth) const;
  void DrawLegend(const Box& frame, bool truth, Canvas* canvas) const;

  const v1::Scenario& scenario_;
  const v1::Agent& target_;
  const v1::TargetPrediction& prediction_;
  const ScenePlotOptions& options_;
  scene::Pose2 X_WT_;
  std::vector<ActionLines> actions_;  // the most important last, above the others
  std::vector<scene::LanePath> lane_paths_;
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_TARGET_PANEL_H_
