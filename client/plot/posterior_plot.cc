#include "client/plot/posterior_plot.h"

#include <algorithm>
#include <exception>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/canvas.h"
#include "client/plot/picture_size.h"
#include "client/plot/scene_layers.h"
#include "client/plot/target_panel.h"

namespace maneuver::plot {
namespace {

constexpr double kTitle = 44.0;  // pixels over both panels
constexpr double kWide = 1.9;    // of an extent: width by height

absl::StatusOr<std::string> PaintPosteriors(const v1::Scenario& scenario,
                                            const v1::TargetPrediction& generic,
                                            const v1::TargetPrediction& posterior,
                                            const v1::Agent& target,
                                            const ScenePlotOptions& options) {
  TargetPanel first(scenario, target, generic, options);
  TargetPanel second(scenario, target, posterior, options);
  for (TargetPanel* panel : {&first, &second}) {
    if (absl::Status status = panel->Prepare(); !status.ok()) return status;
  }
  Extent shown = first.Shown();
  const Extent other = second.Shown();
  shown.Include(other.min_x, other.min_y);
  shown.Include(other.max_x, other.max_y);

  // Side by side, or one above the other if the extent is wide.
  const double aspect = (shown.max_x - shown.min_x) / (shown.max_y - shown.min_y);
  const bool stacked = aspect > kWide;
  const int width = options.width > 0 ? options.width : stacked ? 1500 : 1800;
  const double panel_height = stacked ? std::max(380.0, (width - 94.0) / aspect + 100.0) : 816.0;
  const int height = options.height > 0
                         ? options.height
                         : static_cast<int>(kTitle + panel_height * (stacked ? 2.0 : 1.0));
  absl::Status status = CheckSize(width, height);
  if (!status.ok()) return status;

  Canvas canvas(width, height, {15, 16, 20});
  const GridShape grid = stacked ? GridShape{1, 2} : GridShape{2, 1};
  const Box whole{0.0, kTitle, double(width), height - kTitle};
  first.Draw(CellOf(grid, 0, whole), shown, {"generic action, p(z|y)", stacked}, &canvas);
  second.Draw(CellOf(grid, 1, whole), shown, {"in this scene, q(z|y,s)", !stacked}, &canvas);
  canvas.Text(absl::StrFormat("%s   target %d   t = %.1f s", scenario.scenario_id(), target.id(),
                              scenario.prediction_time()),
              {76.0, 34.0}, 13.0, kText, Anchor::kLeft, true);
  canvas.Text(options.model_version, {width - 18.0, 34.0}, 10.0, kFaintText, Anchor::kRight);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawGenericAndPosterior(const v1::Scenario& scenario,
                                                    const v1::ScenarioPrediction& generic,
                                                    const v1::ScenarioPrediction& posterior,
                                                    const ScenePlotOptions& options) {
  for (const v1::TargetPrediction& one : generic.targets()) {
    for (const v1::TargetPrediction& other : posterior.targets()) {
      const v1::Agent* agent = AgentInSight(scenario, one.target_id());
      if (one.target_id() != other.target_id() || one.has_error() || other.has_error() ||
          agent == nullptr) {
        continue;
      }
      try {
        return PaintPosteriors(scenario, one, other, *agent, options);
      } catch (const std::exception& error) {  // OpenCV's exceptions end here
        return absl::InternalError(absl::StrCat("cannot draw the scene: ", error.what()));
      }
    }
  }
  return absl::InvalidArgumentError(absl::StrCat("nothing to draw: no visible target of ",
                                                 scenario.scenario_id(), " has two answers"));
}

}  // namespace maneuver::plot
