#include "client/plot/scene_plot.h"

#include <algorithm>
#include <exception>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/plot/canvas.h"
#include "client/plot/joint_panels.h"
#include "client/plot/picture_size.h"
#include "client/plot/scene_layers.h"
#include "client/plot/target_panel.h"
#include "model/scene/road_map.h"

namespace maneuver::plot {
namespace {

absl::StatusOr<std::string> PaintJoint(const v1::Scenario& scenario,
                                       const v1::ScenarioPrediction& prediction,
                                       const ScenePlotOptions& options) {
  JointPanels panels(scenario, prediction, options);
  absl::Status status = panels.Prepare();
  if (!status.ok()) return status;
  const GridShape grid = ShapeOf(panels.size());
  const int width = options.width > 0 ? options.width : 1000 * grid.columns;
  const int height = options.height > 0 ? options.height : 700 * grid.rows;
  status = CheckSize(width, height);
  if (!status.ok()) return status;
  Canvas canvas(width, height, {15, 16, 20});
  for (int i = 0; i < panels.size(); ++i) {
    panels.Draw(i, CellOf(grid, i, {0.0, 0.0, double(width), double(height)}), &canvas);
  }
  return canvas.EncodePng();
}

absl::StatusOr<std::string> PaintScene(const v1::Scenario& scenario,
                                       const v1::ScenarioPrediction& prediction,
                                       const ScenePlotOptions& options) {
  if (!prediction.joint().combinations().empty()) return PaintJoint(scenario, prediction, options);
  std::optional<scene::RoadMap> map;
  if (options.lane_paths) map.emplace(scene::RoadMap::Over(scenario.map_features()));
  std::vector<TargetPanel> panels;
  for (const v1::TargetPrediction& target : prediction.targets()) {
    if (target.has_error()) continue;
    const v1::Agent* agent = AgentInSight(scenario, target.target_id());
    if (agent == nullptr) continue;
    panels.emplace_back(scenario, *agent, target, options);
    if (map) panels.back().FindLanePaths(map->lanes());
    absl::Status status = panels.back().Prepare();
    if (!status.ok()) return status;
  }
  if (panels.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("nothing to draw: no visible target of ",
                                                   scenario.scenario_id(), " has an answer"));
  }
  const GridShape grid = ShapeOf(static_cast<int>(panels.size()));
  const bool alone = panels.size() == 1;
  const PictureSize size = alone ? PictureSize{1500, 1000} : SizeFor(grid, 1000.0, 700.0);
  const int width = options.width > 0 ? options.width : size.width;
  const int height = options.height > 0 ? options.height : size.height;
  absl::Status status = CheckSize(width, height);
  if (!status.ok()) return status;
  Canvas canvas(width, height, {15, 16, 20});
  for (size_t i = 0; i < panels.size(); ++i) {
    panels[i].Draw(CellOf(grid, static_cast<int>(i), {0.0, 0.0, double(width), double(height)}),
                   panels[i].Shown(), {}, &canvas);
  }
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawScene(const v1::Scenario& scenario,
                                      const v1::ScenarioPrediction& prediction,
                                      const ScenePlotOptions& options) {
  try {
    return PaintScene(scenario, prediction, options);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the scene: ", error.what()));
  }
}

}  // namespace maneuver::plot
