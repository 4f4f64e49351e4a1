#include "client/plot/joint_panels.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/label_placer.h"
#include "client/plot/panel_layout.h"
#include "client/plot/scene_layers.h"
#include "client/plot/target_panel.h"

namespace maneuver::plot {
namespace {

constexpr double kLeastExtent = 40.0;  // metres

scene::Pose2 PoseNow(const v1::Scenario& scenario, const v1::Agent& agent) {
  const v1::AgentState& now = agent.states(StateNow(agent, scenario.prediction_time()));
  return {now.x(), now.y(), now.heading()};
}

Color ColorOf(size_t number) { return ActionColor(static_cast<int>(number)); }

}  // namespace

absl::Status JointPanels::Read(int target, int action, Part* part) const {
  const int64_t id = part->agent->id();
  const auto& targets = prediction_.targets();
  const auto found = std::ranges::find(targets, id, &v1::TargetPrediction::target_id);
  if (found == targets.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("joint.target_ids[", target, "] is ", id, ", which has no answer"));
  }
  const auto described =
      std::ranges::find(found->distributions(), action, &v1::ActionDistribution::action_id);
  if (described == found->distributions().end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("action ", action, " of target ", id, " is combined and not described"));
  }
  const v1::Trajectory& mean = described->mean_trajectory();
  if (mean.x_size() != mean.y_size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("a trajectory of target ", id, " has unequal numbers of x and y"));
  }
  const scene::Pose2 X_WT = PoseNow(scenario_, *part->agent);
  part->action = action;
  part->mean = {{X_WT.x(), X_WT.y()}};
  for (int t = 0; t < mean.x_size(); ++t) {
    const scene::Point2 point{mean.x(t), mean.y(t)};
    part->mean.push_back(options_.frame == v1::FRAME_TARGET ? X_WT * point : point);
  }
  return absl::OkStatus();
}

absl::Status JointPanels::Prepare() {
  const v1::JointPrediction& joint = prediction_.joint();
  for (const v1::JointCombination& combination : joint.combinations()) {
    if (size() == kMostJointPanels) break;
    Panel panel{.weight = combination.weight()};
    const int targets = std::min(joint.target_ids_size(), combination.action_ids_size());
    for (int i = 0; i < targets; ++i) {
      Part part{.agent = AgentInSight(scenario_, joint.target_ids(i)),
                .number = static_cast<size_t>(i)};
      if (part.agent == nullptr) continue;
      if (auto status = Read(i, combination.action_ids(i), &part); !status.ok()) return status;
      panel.parts.push_back(std::move(part));
    }
    if (panel.parts.empty()) {
      return absl::InvalidArgumentError("nothing to draw: no combined target is visible");
    }
    panels_.push_back(std::move(panel));
  }
  X_WT_ = PoseNow(scenario_, *panels_.front().parts.front().agent);
  return absl::OkStatus();
}

Extent JointPanels::Shown() const {
  Extent extent;
  for (const Panel& panel : panels_) {
    for (const Part& part : panel.parts) {
      for (const scene::Point2& p_W : part.mean) {
        const scene::Point2 p = X_WT_.ToLocal(p_W);
        extent.Include(p.x, p.y);
      }
    }
  }
  const double margin = 6.0 + 0.06 * (extent.max_x - extent.min_x);
  const auto widen = [&](double* low, double* high) {
    const double middle = (*low + *high) / 2.0;
    const double half = std::max(*high - *low + 2.0 * margin, kLeastExtent) / 2.0;
    *low = middle - half;
    *high = middle + half;
  };
  widen(&extent.min_x, &extent.max_x);
  widen(&extent.min_y, &extent.max_y);
  return extent;
}

std::string JointPanels::NameOf(const Part& part) const {
  const auto found = options_.labels.find(part.action);
  const std::string label = found == options_.labels.end() ? "" : found->second;
  return absl::StrCat("target ", part.agent->id(), ": action ", part.action,
                      label.empty() ? "" : ", ", label);
}

// Returns the upper corner where the legend covers less of what the targets may do.
Box JointPanels::LegendBox(const Panel& panel, const ScenePanel& scene) const {
  const Box& box = scene.axes.box();
  double width = 0.0;
  for (const Part& part : panel.parts) {
    width = std::max(width, Canvas::TextWidth(NameOf(part), kLetters));
  }
  width += 52.0;
  const double height = kRow * static_cast<double>(panel.parts.size()) + 14.0;
  const Box right{box.right() - width - 10.0, box.top + 10.0, width, height};
  const Box left{box.left + 10.0, box.top + 10.0, width, height};
  const auto covered = [&](const Box& corner) {
    int64_t points = 0;
    for (const Part& part : panel.parts) {
      points += std::ranges::count_if(part.mean, [&](const scene::Point2& p) {
        return corner.Holds(scene.FromWorld(p.x, p.y));
      });
    }
    return points;
  };
  return covered(left) < covered(right) ? left : right;
}

void JointPanels::DrawLegend(const Panel& panel, const Box& frame, Canvas* canvas) const {
  canvas->Rectangle(frame, {10, 11, 14}, 0.78);
  double y = frame.top + 7.0 + kRow / 2.0;
  for (const Part& part : panel.parts) {
    canvas->Stroke({{frame.left + 10.0, y}, {frame.left + 30.0, y}}, ColorOf(part.number), 3.2);
    canvas->Text(NameOf(part), {frame.left + 42.0, y + kLetters / 2.0}, kLetters, kText);
    y += kRow;
  }
}

void JointPanels::Draw(int index, const Box& cell, Canvas* canvas) const {
  const Panel& shown = panels_[static_cast<size_t>(index)];
  const Box box = AxesBox(cell);
  const ScenePanel panel{&scenario_, X_WT_, Axes(box, Shown())};
  const AxesStyle axes{{96, 99, 107}, kFaintText, {31, 34, 40}};
  canvas->ClipTo(box);
  panel.axes.DrawGrid(axes, canvas);
  DrawMap(panel, canvas);
  DrawSignals(panel, canvas);
  DrawOtherAgents(panel, shown.parts.front().agent->id(), canvas);
  for (const Part& part : shown.parts) DrawTarget(panel, *part.agent, canvas);
  const Box legend = LegendBox(shown, panel);
  LabelPlacer placer(box);
  placer.Occupy(legend);
  for (const Part& part : shown.parts) {
    const Color color = ColorOf(part.number);
    Line line;
    for (const scene::Point2& p : part.mean) line.push_back(panel.FromWorld(p.x, p.y));
    canvas->Stroke(line, kGround, 6.0, 0.55);
    canvas->Stroke(line, color, 3.2);
    // A dot each second: where the targets are at the same time.
    const double waypoints = static_cast<double>(line.size() - 1);
    for (int second = 1; second < options_.horizon; ++second) {
      const auto t = static_cast<size_t>(std::lround(second / options_.horizon * waypoints));
      canvas->Disc(line[t], 3.2, kText);
    }
    canvas->Disc(line.back(), 4.6, color);
    placer.Occupy(line, 8.0);
  }
  for (const Part& part : shown.parts) {
    const scene::Point2& end = part.mean.back();
    const std::string id = absl::StrCat(part.agent->id());
    const auto place = placer.Place(panel.FromWorld(end.x, end.y), id, 10.0, 40.0);
    if (!place) continue;
    canvas->Rectangle(place->frame, kGround, 0.72);
    canvas->Text(id, place->baseline, 10.0, ColorOf(part.number), Anchor::kCenter, true);
  }
  DrawLegend(shown, legend, canvas);
  canvas->ClipToAll();
  panel.axes.DrawFrame(axes, canvas);
  canvas->Text(absl::StrFormat("%s   t = %.1f s   combination %d of %d   %.1f %%",
                               scenario_.scenario_id(), scenario_.prediction_time(), index + 1,
                               prediction_.joint().combinations_size(), 100.0 * shown.weight),
               {box.left, cell.top + 30.0}, 12.0, kText, Anchor::kLeft, true);
  if (index == 0) {
    canvas->Text(options_.model_version, {box.right(), cell.top + 30.0}, 10.0, kFaintText,
                 Anchor::kRight);
  }
}

}  // namespace maneuver::plot
