#include "client/plot/scene_plot.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/picture_size.h"
#include "client/plot/scene_layers.h"

namespace maneuver::plot {
namespace {

constexpr double kHeader = 46.0;      // pixels over each panel
constexpr double kLeftMargin = 76.0;  // for the axis' numbers
constexpr double kRightMargin = 18.0;
constexpr double kLowerMargin = 54.0;
constexpr double kLeastWidth = 60.0;  // metres that a panel shows at least
constexpr double kLeastHeight = 40.0;

// The trajectories of one action, in the target's frame, metres.
struct ActionLines {
  const v1::ActionDistribution* distribution;
  std::vector<std::vector<scene::Point2>> sigma;
  std::vector<scene::Point2> mean;
};

class TargetPanel {
 public:
  TargetPanel(const v1::Scenario& scenario, const v1::Agent& target,
              const v1::TargetPrediction& prediction, const ScenePlotOptions& options)
      : scenario_(scenario), target_(target), prediction_(prediction), options_(options) {
    const v1::AgentState& now = target.states(StateNow(target, scenario.prediction_time()));
    X_WT_ = scene::Pose2(now.x(), now.y(), now.heading());
  }

  absl::Status Prepare() {
    for (const v1::ActionDistribution& distribution : prediction_.distributions()) {
      if (distribution.probability() < options_.min_probability) continue;
      ActionLines lines{&distribution, {}, {}};
      for (const v1::Trajectory& sigma : distribution.sigma_trajectories()) {
        lines.sigma.emplace_back();
        absl::Status status = Read(sigma, &lines.sigma.back());
        if (!status.ok()) return status;
      }
      absl::Status status = Read(distribution.mean_trajectory(), &lines.mean);
      if (!status.ok()) return status;
      actions_.push_back(std::move(lines));
    }
    // The most probable last, over the others.
    std::stable_sort(actions_.begin(), actions_.end(), [](const auto& a, const auto& b) {
      return a.distribution->probability() < b.distribution->probability();
    });
    return absl::OkStatus();
  }

  void Draw(const Box& cell, Canvas* canvas) const {
    const Box box{cell.left + kLeftMargin, cell.top + kHeader,
                  cell.width - kLeftMargin - kRightMargin, cell.height - kHeader - kLowerMargin};
    const ScenePanel panel{&scenario_, X_WT_, Axes(box, Shown())};
    const AxesStyle style{{96, 99, 107}, kFaintText, {31, 34, 40}};
    canvas->ClipTo(box);
    panel.axes.DrawGrid(style, canvas);
    DrawMap(panel, canvas);
    DrawSignals(panel, canvas);
    DrawOtherAgents(panel, target_.id(), canvas);
    for (const ActionLines& action : actions_) DrawSigma(panel, action, canvas);
    for (const ActionLines& action : actions_) DrawMean(panel, action, canvas);
    const Line truth = TruthLine(panel, target_, options_.horizon);
    canvas->Stroke(truth, kGround, 5.0, 0.7);
    canvas->Stroke(truth, kTruth, 2.6);
    if (!truth.empty()) canvas->Disc(truth.back(), 4.0, kTruth);
    DrawTarget(panel, target_, canvas);
    DrawScaleBar(panel, canvas);
    DrawLegend(box, !truth.empty(), canvas);
    canvas->ClipToAll();
    panel.axes.DrawFrame(style, canvas);
    DrawHeader(cell, box, canvas);
  }

 private:
  absl::Status Read(const v1::Trajectory& trajectory, std::vector<scene::Point2>* points) const {
    if (trajectory.x_size() != trajectory.y_size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("a trajectory of target ", target_.id(), " has unequal numbers of x and y"));
    }
    // Every action starts where the target stands.
    points->push_back({0.0, 0.0});
    for (int i = 0; i < trajectory.x_size(); ++i) {
      const scene::Point2 point{trajectory.x(i), trajectory.y(i)};
      points->push_back(options_.frame == v1::FRAME_TARGET ? point : X_WT_.ToLocal(point));
    }
    return absl::OkStatus();
  }

  // What has to be seen: the target, what it may do, and what it did.
  Extent Shown() const {
    Extent extent;
    extent.Include(-target_.length(), 0.0);
    for (const ActionLines& action : actions_) {
      for (const scene::Point2& p : action.mean) extent.Include(p.x, p.y);
      for (const auto& line : action.sigma) {
        for (const scene::Point2& p : line) extent.Include(p.x, p.y);
      }
    }
    const double now = scenario_.prediction_time();
    for (const v1::AgentState& state : target_.states()) {
      if (state.time() < now - 1.0) continue;
      if (options_.horizon > 0.0 && state.time() > now + options_.horizon) continue;
      const scene::Point2 p = X_WT_.ToLocal({state.x(), state.y()});
      extent.Include(p.x, p.y);
    }
    const double margin = 6.0 + 0.06 * (extent.max_x - extent.min_x);
    const double width = std::max(extent.max_x - extent.min_x + 2.0 * margin, kLeastWidth);
    const double height = std::max(extent.max_y - extent.min_y + 2.0 * margin, kLeastHeight);
    const double x = (extent.min_x + extent.max_x) / 2.0;
    const double y = (extent.min_y + extent.max_y) / 2.0;
    return {x - width / 2.0, x + width / 2.0, y - height / 2.0, y + height / 2.0};
  }

  static Line ToPixels(const ScenePanel& panel, const std::vector<scene::Point2>& points) {
    Line line;
    for (const scene::Point2& p : points) line.push_back(panel.axes.ToPixel(p.x, p.y));
    return line;
  }

  void DrawSigma(const ScenePanel& panel, const ActionLines& action, Canvas* canvas) const {
    std::vector<Line> lines;
    for (const auto& sigma : action.sigma) lines.push_back(ToPixels(panel, sigma));
    canvas->Strokes(lines, ActionColor(action.distribution->action_id()), 1.2, 0.55);
  }

  void DrawMean(const ScenePanel& panel, const ActionLines& action, Canvas* canvas) const {
    const Line line = ToPixels(panel, action.mean);
    const Color color = ActionColor(action.distribution->action_id());
    canvas->Stroke(line, kGround, 6.0, 0.55);
    canvas->Stroke(line, color, 3.2);
    canvas->Disc(line.back(), 4.6, color);
  }

  void DrawScaleBar(const ScenePanel& panel, Canvas* canvas) const {
    const Box& box = panel.axes.box();
    double meters = 100.0;
    for (const double length : {50.0, 20.0, 10.0, 5.0, 2.0}) {
      if (meters * panel.axes.pixels_per_meter() > box.width / 6.0) meters = length;
    }
    const double width = meters * panel.axes.pixels_per_meter();
    const double y = box.bottom() - 16.0;
    const double x = box.left + 16.0;
    canvas->Strokes({{{x, y}, {x + width, y}},
                     {{x, y - 4}, {x, y + 4}},
                     {{x + width, y - 4}, {x + width, y + 4}}},
                    kText, 1.6);
    canvas->Text(absl::StrFormat("%g m", meters), {x + width / 2.0, y - 8.0}, 9.0, kText,
                 Anchor::kCenter);
  }

  std::string Label(int action_id) const {
    const auto label = options_.labels.find(action_id);
    return label == options_.labels.end() ? "" : label->second;
  }

  // Swatch, id, label and probability of each action, most probable first; then the other lines.
  void DrawLegend(const Box& box, bool truth, Canvas* canvas) const {
    constexpr double kRow = 20.0;
    constexpr double kLetters = 10.0;
    constexpr double kBar = 70.0;  // pixels of probability 1
    double label_width = 0.0;
    for (const ActionLines& action : actions_) {
      label_width = std::max(label_width,
                             Canvas::TextWidth(Label(action.distribution->action_id()), kLetters));
    }
    if (label_width > 0.0) label_width += 14.0;
    const size_t rows = actions_.size() + (truth ? 2 : 1);
    const double width = 34.0 + 24.0 + label_width + kBar + 78.0;
    const Box frame{box.right() - width - 10.0, box.top + 10.0, width,
                    kRow * static_cast<double>(rows) + 14.0};
    canvas->Rectangle(frame, {10, 11, 14}, 0.78);
    double y = frame.top + 7.0 + kRow / 2.0;
    const double swatch = frame.left + 10.0;
    for (auto action = actions_.rbegin(); action != actions_.rend(); ++action, y += kRow) {
      const v1::ActionDistribution& distribution = *action->distribution;
      const Color color = ActionColor(distribution.action_id());
      const double baseline = y + kLetters / 2.0;
      canvas->Stroke({{swatch, y}, {swatch + 20.0, y}}, color, 3.2);
      canvas->Text(absl::StrCat(distribution.action_id()), {swatch + 46.0, baseline}, kLetters,
                   kText, Anchor::kRight);
      canvas->Text(Label(distribution.action_id()), {swatch + 58.0, baseline}, kLetters, kText);
      const double bar = swatch + 58.0 + label_width;
      canvas->Rectangle({bar, y - 5.0, kBar, 10.0}, color, 0.18);
      canvas->Rectangle(
          {bar, y - 5.0, kBar * std::clamp(distribution.probability(), 0.0, 1.0), 10.0}, color,
          0.95);
      canvas->Text(absl::StrFormat("%.1f %%", 100.0 * distribution.probability()),
                   {frame.right() - 8.0, baseline}, kLetters, kText, Anchor::kRight);
    }
    const auto key = [&](Color color, const std::string& text) {
      canvas->Stroke({{swatch, y}, {swatch + 20.0, y}}, color, 2.6);
      canvas->Text(text, {swatch + 34.0, y + kLetters / 2.0}, kLetters, kFaintText);
      y += kRow;
    };
    key(kTarget, "target, past second");
    if (truth) key(kTruth, "what it really did");
  }

  void DrawHeader(const Box& cell, const Box& box, Canvas* canvas) const {
    canvas->Text(absl::StrFormat("%s   target %d   t = %.1f s", scenario_.scenario_id(),
                                 target_.id(), scenario_.prediction_time()),
                 {box.left, cell.top + 30.0}, 12.0, kText, Anchor::kLeft, true);
    canvas->Text(options_.model_version, {box.right(), cell.top + 30.0}, 10.0, kFaintText,
                 Anchor::kRight);
  }

  const v1::Scenario& scenario_;
  const v1::Agent& target_;
  const v1::TargetPrediction& prediction_;
  const ScenePlotOptions& options_;
  scene::Pose2 X_WT_;
  std::vector<ActionLines> actions_;
};

absl::StatusOr<std::string> Draw(const v1::Scenario& scenario,
                                 const v1::ScenarioPrediction& prediction,
                                 const ScenePlotOptions& options) {
  std::vector<TargetPanel> panels;
  for (const v1::TargetPrediction& target : prediction.targets()) {
    if (target.has_error()) continue;
    const auto& agents = scenario.agents();
    const auto agent = std::find_if(agents.begin(), agents.end(), [&](const v1::Agent& any) {
      return any.id() == target.target_id();
    });
    if (agent == agents.end() || StateNow(*agent, scenario.prediction_time()) < 0) continue;
    panels.emplace_back(scenario, *agent, target, options);
    absl::Status status = panels.back().Prepare();
    if (!status.ok()) return status;
  }
  if (panels.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "nothing to draw: no target of ", scenario.scenario_id(), " was answered and is in sight"));
  }
  const GridShape grid = ShapeOf(static_cast<int>(panels.size()));
  const bool alone = panels.size() == 1;
  const int width = options.width > 0 ? options.width : alone ? 1500 : 1000 * grid.columns;
  const int height = options.height > 0 ? options.height : alone ? 1000 : 700 * grid.rows;
  absl::Status status = CheckSize(width, height);
  if (!status.ok()) return status;
  Canvas canvas(width, height, {15, 16, 20});
  for (size_t i = 0; i < panels.size(); ++i) {
    panels[i].Draw(CellOf(grid, static_cast<int>(i), {0.0, 0.0, double(width), double(height)}),
                   &canvas);
  }
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawScene(const v1::Scenario& scenario,
                                      const v1::ScenarioPrediction& prediction,
                                      const ScenePlotOptions& options) {
  try {
    return Draw(scenario, prediction, options);
  } catch (const std::exception& error) {  // OpenCV's end here
    return absl::InternalError(absl::StrCat("cannot draw the scene: ", error.what()));
  }
}

}  // namespace maneuver::plot
