#include "client/plot/target_panel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/label_placer.h"
#include "client/plot/panel_layout.h"
#include "client/plot/trajectory_points.h"
#include "model/scene/target_frame.h"

namespace maneuver::plot {
namespace {

constexpr double kLeastWidth = 60.0;  // metres that a panel shows at least
constexpr double kLeastHeight = 40.0;
constexpr double kOnFoot = 0.4;      // factor of both for pedestrians, who walk about 7 m in 5 s
constexpr double kBar = 70.0;        // pixels of probability 1
constexpr double kMedoidLine = 5.0;  // widths of means, pixels
constexpr double kFaintLine = 1.6;

// Returns what the sigma trajectories sweep: for each two waypoints, the convex hull of their
// points.
std::vector<Line> SweptBy(const std::vector<Line>& sigma) {
  std::vector<Line> swept;
  size_t waypoints = sigma.empty() ? 0 : sigma.front().size();
  for (const Line& line : sigma) waypoints = std::min(waypoints, line.size());
  for (size_t t = 0; t + 1 < waypoints; ++t) {
    std::vector<cv::Point2f> points;
    for (const Line& line : sigma) {
      points.emplace_back(line[t]);
      points.emplace_back(line[t + 1]);
    }
    std::vector<cv::Point2f> hull;
    cv::convexHull(points, hull);
    swept.emplace_back(hull.begin(), hull.end());
  }
  return swept;
}

void DrawScaleBar(const ScenePanel& panel, Canvas* canvas) {
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

}  // namespace

const v1::Agent* AgentInSight(const v1::Scenario& scenario, int64_t agent_id) {
  const v1::Agent* const agent = scene::FindAgent(scenario, agent_id);
  const bool in_sight = agent != nullptr && StateNow(*agent, scenario.prediction_time()) >= 0;
  return in_sight ? agent : nullptr;
}

TargetPanel::TargetPanel(const v1::Scenario& scenario, const v1::Agent& target,
                         const v1::TargetPrediction& prediction, const ScenePlotOptions& options)
    : scenario_(scenario), target_(target), prediction_(prediction), options_(options) {
  const v1::AgentState& now = target.states(StateNow(target, scenario.prediction_time()));
  X_WT_ = scene::Pose2(now.x(), now.y(), now.heading());
}

void TargetPanel::FindLanePaths(const scene::LaneGraph& lanes) {
  lane_paths_ = scene::LanePathFinder().Describe(scenario_, lanes, scenario_.prediction_time(),
                                                 target_.id(), X_WT_);
}

absl::Status TargetPanel::Prepare() {
  std::map<int, int> ranks;  // of the representatives, by action
  for (const v1::Representative& representative : prediction_.representatives()) {
    ranks.emplace(representative.action_id(), static_cast<int>(ranks.size()) + 1);
  }
  for (const v1::ActionDistribution& distribution : prediction_.distributions()) {
    const auto rank = ranks.find(distribution.action_id());
    ActionLines lines{&distribution};
    lines.share = distribution.probability();
    if (rank != ranks.end()) {
      lines.rank = rank->second;
      lines.share = prediction_.representatives(rank->second - 1).weight();
    } else if (distribution.probability() < options_.min_probability) {
      continue;
    }
    for (const v1::Trajectory& sigma : distribution.sigma_trajectories()) {
      if (IsFaint(lines)) break;
      lines.sigma.emplace_back();
      absl::Status status = Read(sigma, &lines.sigma.back());
      if (!status.ok()) return status;
    }
    absl::Status status = Read(distribution.mean_trajectory(), &lines.mean);
    if (!status.ok()) return status;
    actions_.push_back(std::move(lines));
  }
  // The medoid comes last, after the other representatives; without any, the most probable action.
  std::stable_sort(actions_.begin(), actions_.end(), [](const auto& a, const auto& b) {
    if (a.rank > 0 && b.rank > 0) return a.rank > b.rank;
    if (a.rank != b.rank) return a.rank == 0;
    return a.distribution->probability() < b.distribution->probability();
  });
  return absl::OkStatus();
}

absl::Status TargetPanel::Read(const v1::Trajectory& trajectory,
                               std::vector<scene::Point2>* points) const {
  if (trajectory.x_size() != trajectory.y_size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("a trajectory of target ", target_.id(), " has unequal numbers of x and y"));
  }
  // Every action starts at the target's position.
  points->push_back({0.0, 0.0});
  for (int i = 0; i < trajectory.x_size(); ++i) {
    const scene::Point2 point{trajectory.x(i), trajectory.y(i)};
    points->push_back(options_.frame == v1::FRAME_TARGET ? point : X_WT_.ToLocal(point));
  }
  return absl::OkStatus();
}

Extent TargetPanel::Shown() const {
  Extent extent;
  extent.Include(-target_.length(), 0.0);
  for (const ActionLines& action : actions_) {
    for (const scene::Point2& p : action.mean) extent.Include(p.x, p.y);
    for (const auto& line : action.sigma) {
      for (const scene::Point2& p : line) extent.Include(p.x, p.y);
    }
  }
  if (actions_.empty()) {
    for (const scene::LanePath& path : lane_paths_) {
      for (const scene::Point2& p : InTarget(path)) extent.Include(p.x, p.y);
    }
  }
  const double now = scenario_.prediction_time();
  for (const v1::AgentState& state : target_.states()) {
    if (state.time() < now - 1.0) continue;
    if (options_.horizon > 0.0 && state.time() > now + options_.horizon) continue;
    const scene::Point2 p = X_WT_.ToLocal({state.x(), state.y()});
    extent.Include(p.x, p.y);
  }
  const double share = target_.type() == v1::AGENT_TYPE_PEDESTRIAN ? kOnFoot : 1.0;
  const double margin = 6.0 * share + 0.06 * (extent.max_x - extent.min_x);
  const double width = std::max(extent.max_x - extent.min_x + 2.0 * margin, share * kLeastWidth);
  const double height = std::max(extent.max_y - extent.min_y + 2.0 * margin, share * kLeastHeight);
  const double x = (extent.min_x + extent.max_x) / 2.0;
  const double y = (extent.min_y + extent.max_y) / 2.0;
  return {x - width / 2.0, x + width / 2.0, y - height / 2.0, y + height / 2.0};
}

void TargetPanel::Draw(const Box& cell, const Extent& shown, const Style& style,
                       Canvas* canvas) const {
  const Box box = AxesBox(cell);
  const ScenePanel panel{&scenario_, X_WT_, Axes(box, shown)};
  const AxesStyle axes{{96, 99, 107}, kFaintText, {31, 34, 40}};
  canvas->ClipTo(box);
  panel.axes.DrawGrid(axes, canvas);
  DrawMap(panel, canvas);
  DrawSignals(panel, canvas);
  DrawLanePaths(panel, lane_paths_, canvas);
  DrawOtherAgents(panel, target_.id(), canvas);
  DrawLeaders(panel, lane_paths_, canvas);
  for (const ActionLines& action : actions_) DrawSigma(panel, action, canvas);
  for (const ActionLines& action : actions_) DrawMean(panel, action, canvas);
  const Line truth = TruthLine(panel, target_, options_.horizon);
  canvas->Stroke(truth, kGround, 5.0, 0.7);
  canvas->Stroke(truth, kTruth, 2.6);
  if (!truth.empty()) canvas->Disc(truth.back(), 4.0, kTruth);
  DrawTarget(panel, target_, canvas);
  DrawScaleBar(panel, canvas);
  const Box legend = style.legend ? LegendBox(panel, truth) : Box();
  DrawIds(panel, legend, truth, canvas);
  if (style.legend) DrawLegend(legend, !truth.empty(), canvas);
  canvas->ClipToAll();
  panel.axes.DrawFrame(axes, canvas);
  const std::string title =
      style.title.empty() ? absl::StrFormat("%s   target %d   t = %.1f s", scenario_.scenario_id(),
                                            target_.id(), scenario_.prediction_time())
                          : style.title;
  canvas->Text(title, {box.left, cell.top + 30.0}, 12.0, kText, Anchor::kLeft, true);
  if (style.title.empty()) {
    canvas->Text(options_.model_version, {box.right(), cell.top + 30.0}, 10.0, kFaintText,
                 Anchor::kRight);
  }
}

std::vector<scene::Point2> TargetPanel::InTarget(const scene::LanePath& path) const {
  std::vector<scene::Point2> points;
  for (const scene::Point2& point : path.points) points.push_back(X_WT_.ToLocal(point));
  return points;
}

void TargetPanel::DrawSigma(const ScenePanel& panel, const ActionLines& action,
                            Canvas* canvas) const {
  std::vector<Line> lines;
  for (const auto& sigma : action.sigma) lines.push_back(ToPixels(panel.axes, sigma));
  const Color color = ActionColor(action.distribution->action_id());
  canvas->Polygons(SweptBy(lines), color, 0.16);
  canvas->Strokes(lines, color, 1.0, 0.5);
}

void TargetPanel::DrawMean(const ScenePanel& panel, const ActionLines& action,
                           Canvas* canvas) const {
  const Line line = ToPixels(panel.axes, action.mean);
  const Color color = ActionColor(action.distribution->action_id());
  if (IsFaint(action)) {
    canvas->Stroke(line, color, kFaintLine, 0.6);
    return;
  }
  canvas->Stroke(line, kGround, 6.0, 0.55);
  canvas->Stroke(line, color, action.rank == 1 ? kMedoidLine : 3.2);
  if (action.rank == 1) canvas->Disc(line.back(), 8.0, kText);
  canvas->Disc(line.back(), action.rank == 1 ? 5.8 : 4.6, color);
}

// Draws the number of each action at the end of its mean, if there is room.
void TargetPanel::DrawIds(const ScenePanel& panel, const Box& legend, const Line& truth,
                          Canvas* canvas) const {
  LabelPlacer placer(panel.axes.box());
  placer.Occupy(legend);
  placer.Occupy(truth, 12.0);
  const Pixel rear_left = panel.axes.ToPixel(-target_.length() / 2.0, target_.width() / 2.0);
  const double scale = panel.axes.pixels_per_meter();
  placer.Occupy({rear_left.x, rear_left.y, scale * target_.length(), scale * target_.width()});
  for (const ActionLines& action : actions_) placer.Occupy(ToPixels(panel.axes, action.mean), 8.0);
  for (auto action = actions_.rbegin(); action != actions_.rend(); ++action) {
    if (IsFaint(*action)) continue;
    const Line line = ToPixels(panel.axes, action->mean);
    const std::string number = absl::StrCat(NumberOf(*action));
    const auto place = placer.Place(line.back(), number, 10.0, 40.0);
    if (!place) continue;
    canvas->Rectangle(place->frame, kGround, 0.72);
    canvas->Text(number, place->baseline, 10.0, ActionColor(action->distribution->action_id()),
                 Anchor::kCenter, true);
  }
}

int TargetPanel::NumberOf(const ActionLines& action) const {
  return HasRepresentatives() ? action.rank : action.distribution->action_id();
}

std::string TargetPanel::NameOf(const ActionLines& action) const {
  const int id = action.distribution->action_id();
  const auto found = options_.labels.find(id);
  const std::string label = found == options_.labels.end() ? "" : found->second;
  if (!HasRepresentatives()) return label;
  return absl::StrCat("action ", id, label.empty() ? "" : ", ", label,
                      action.rank == 1 ? " (medoid)" : "");
}

std::vector<TargetPanel::Key> TargetPanel::Keys(bool truth) const {
  std::vector<Key> keys;
  if (LegendActions() < actions_.size()) {
    keys.push_back({kFaintText, kFaintLine, "other described actions"});
  }
  keys.push_back({kTarget, 2.6, "target, past second"});
  if (truth) keys.push_back({kTruth, 2.6, "what it really did"});
  if (!lane_paths_.empty()) keys.push_back({kLanePath, 2.6, "lane paths, leaders ringed"});
  return keys;
}

size_t TargetPanel::LegendActions() const {
  return static_cast<size_t>(std::ranges::count_if(
      actions_, [this](const ActionLines& action) { return !IsFaint(action); }));
}

// Returns the corner where the legend covers least of what the target may do and did. The lower
// left belongs to the scale bar.
Box TargetPanel::LegendBox(const ScenePanel& panel, const Line& truth) const {
  double label_width = 0.0;
  for (const ActionLines& action : actions_) {
    label_width = std::max(label_width, Canvas::TextWidth(NameOf(action), kLetters));
  }
  if (label_width > 0.0) label_width += 14.0;
  const std::vector<Key> keys = Keys(!truth.empty());
  const size_t rows = LegendActions() + keys.size();
  double width = LegendActions() == 0 ? 0.0 : 34.0 + 24.0 + label_width + kBar + 78.0;
  for (const Key& key : keys) {
    width = std::max(width, 44.0 + Canvas::TextWidth(key.text, kLetters) + 10.0);
  }
  const double height = kRow * static_cast<double>(rows) + 14.0;
  const Box& box = panel.axes.box();
  const double right = box.right() - width - 10.0;
  const std::array<Box, 3> corners = {Box{right, box.top + 10.0, width, height},
                                      {box.left + 10.0, box.top + 10.0, width, height},
                                      {right, box.bottom() - height - 10.0, width, height}};
  const auto covered = [&](const Box& corner) {
    int64_t points = 0;
    const auto count = [&](const Line& line) {
      points += std::count_if(line.begin(), line.end(),
                              [&](const Pixel& pixel) { return corner.Holds(pixel); });
    };
    count(truth);
    for (const scene::LanePath& path : lane_paths_) count(ToPixels(panel.axes, InTarget(path)));
    for (const ActionLines& action : actions_) {
      count(ToPixels(panel.axes, action.mean));
      for (const auto& sigma : action.sigma) count(ToPixels(panel.axes, sigma));
    }
    return points;
  };
  return *std::min_element(corners.begin(), corners.end(),
                           [&](const Box& a, const Box& b) { return covered(a) < covered(b); });
}

// Draws swatch, number, name and share of each action, most important first, then the other lines.
void TargetPanel::DrawLegend(const Box& frame, bool truth, Canvas* canvas) const {
  canvas->Rectangle(frame, {10, 11, 14}, 0.78);
  double y = frame.top + 7.0 + kRow / 2.0;
  const double swatch = frame.left + 10.0;
  for (auto action = actions_.rbegin(); action != actions_.rend(); ++action) {
    if (IsFaint(*action)) continue;
    const Color color = ActionColor(action->distribution->action_id());
    const double baseline = y + kLetters / 2.0;
    canvas->Stroke({{swatch, y}, {swatch + 20.0, y}}, color, 3.2);
    canvas->Text(absl::StrCat(NumberOf(*action)), {swatch + 46.0, baseline}, kLetters, kText,
                 Anchor::kRight);
    canvas->Text(NameOf(*action), {swatch + 58.0, baseline}, kLetters, kText);
    const double bar = frame.right() - kBar - 68.0;
    canvas->Rectangle({bar, y - 5.0, kBar, 10.0}, color, 0.18);
    canvas->Rectangle({bar, y - 5.0, kBar * std::clamp(action->share, 0.0, 1.0), 10.0}, color,
                      0.95);
    canvas->Text(absl::StrFormat("%.1f %%", 100.0 * action->share), {frame.right() - 8.0, baseline},
                 kLetters, kText, Anchor::kRight);
    y += kRow;
  }
  for (const Key& key : Keys(truth)) {
    canvas->Stroke({{swatch, y}, {swatch + 20.0, y}}, key.color, key.width);
    canvas->Text(key.text, {swatch + 34.0, y + kLetters / 2.0}, kLetters, kFaintText);
    y += kRow;
  }
}

}  // namespace maneuver::plot
