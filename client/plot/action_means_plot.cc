#include "client/plot/action_means_plot.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/trajectory_points.h"

namespace maneuver::plot {
namespace {

constexpr int kMeansWidth = 1630;
constexpr double kLegend = 430.0;  // pixels at the right
constexpr double kMeansHeader = 74.0;

struct DrawnAction {
  const v1::Action* action;
  double share;  // mean p(y|s)
  std::string name;
  int examples = 0;  // among the sampled
  Points mean;
  Color color;
};

int ActionOf(const v1::EvaluatedExample& example) {
  const auto& q = example.responsibilities();
  return static_cast<int>(std::max_element(q.begin(), q.end()) - q.begin());
}

double Apart(const Points& a, const Points& b) {
  double sum = 0.0;
  const size_t count = std::min(a.size(), b.size());
  for (size_t i = 0; i < count; ++i) sum += std::hypot(a[i].x - b[i].x, a[i].y - b[i].y);
  return sum / static_cast<double>(std::max<size_t>(1, count));
}

// Assigns the colours from the most frequent action on. Each action takes the colour whose nearest
// user so far is furthest away.
void DealColors(std::vector<DrawnAction>& actions) {
  for (size_t i = 0; i < actions.size(); ++i) {
    double best = -1.0;
    for (int dimension = 0; dimension < kLatentColors; ++dimension) {
      double nearest = std::numeric_limits<double>::max();
      const Color color = LatentColor(dimension);
      for (size_t j = 0; j < i; ++j) {
        const Color& other = actions[j].color;
        if (other.red == color.red && other.green == color.green && other.blue == color.blue) {
          nearest = std::min(nearest, Apart(actions[i].mean, actions[j].mean));
        }
      }
      if (nearest > best) {
        best = nearest;
        actions[i].color = color;
      }
    }
  }
}

absl::StatusOr<std::vector<DrawnAction>> ActionsOf(const v1::ActionSet& set,
                                                   const v1::EvaluationReport& report) {
  std::map<int, int> examples;
  for (const v1::EvaluatedExample& example : report.sampled_examples()) {
    ++examples[ActionOf(example)];
  }
  std::vector<DrawnAction> actions;
  for (const v1::Action& action : set.actions()) {
    const int id = action.action_id();
    if (!action.effective() && !examples.contains(id)) continue;
    const bool used = id < report.action_uses_size();
    DrawnAction drawn{&action,
                      used ? report.action_uses(id).probability() : action.usage(),
                      action.display_name(),
                      examples[id],
                      {},
                      {}};
    auto mean =
        PointsOf(action.distribution().mean_trajectory(), absl::StrCat("the mean of action ", id));
    if (!mean.ok()) return mean.status();
    drawn.mean = *std::move(mean);
    actions.push_back(std::move(drawn));
  }
  std::stable_sort(actions.begin(), actions.end(),
                   [](const auto& a, const auto& b) { return a.share > b.share; });
  DealColors(actions);
  return actions;
}

void DrawMeans(const Axes& axes, const std::vector<DrawnAction>& actions, Canvas* canvas) {
  // The most frequent action comes last, above the others.
  for (auto action = actions.rbegin(); action != actions.rend(); ++action) {
    const Line line = ToPixels(axes, action->mean);
    canvas->Stroke(line, kPaper, 6.0, 0.9);
    canvas->Stroke(line, action->color, 3.4);
    canvas->Disc(line.back(), 5.4, kPaper);
    canvas->Disc(line.back(), 4.2, action->color);
  }
  std::vector<ActionEnd> ends;
  for (const DrawnAction& action : actions) {
    ends.push_back(
        {action.action->action_id(), axes.ToPixel(action.mean.back().x, action.mean.back().y)});
  }
  DrawActionIds(
      axes.box(), ends,
      {.dot = 10.0, .letters = 10.0, .farthest = 120.0, .least_gap = 12.0, .opacity = 0.7}, canvas);
}

// Draws swatch, id, name, mean p(y|s) and number of sampled examples of each action.
void DrawLegend(const std::vector<DrawnAction>& actions, const Box& box, Canvas* canvas) {
  constexpr double kLetters = 9.5;
  const double row =
      std::min(24.0, box.height / static_cast<double>(std::max<size_t>(1, actions.size() + 1)));
  double y = box.top + row / 2.0;
  canvas->Text("mean p(y|s)", {box.right(), y + kLetters / 2.0}, 8.5, kFaintInk, Anchor::kRight);
  canvas->Text("action", {box.left, y + kLetters / 2.0}, 8.5, kFaintInk);
  for (const DrawnAction& action : actions) {
    y += row;
    const double baseline = y + kLetters / 2.0;
    canvas->Stroke({{box.left, y}, {box.left + 20.0, y}}, action.color, 3.4);
    canvas->Text(absl::StrCat(action.action->action_id()), {box.left + 48.0, baseline}, kLetters,
                 kInk, Anchor::kRight, true);
    const std::string share = absl::StrFormat("%.1f %%", 100.0 * action.share);
    canvas->Text(share, {box.right(), baseline}, kLetters, kFaintInk, Anchor::kRight);
    // A long name has smaller letters, so that it ends before the share.
    const double room = box.width - 60.0 - 10.0 - Canvas::TextWidth(share, kLetters);
    canvas->Text(action.name, {box.left + 60.0, baseline},
                 Canvas::HeightToFit(action.name, kLetters, room), kInk);
  }
}

absl::StatusOr<std::string> PaintActionMeans(const v1::ActionSet& set,
                                             const v1::EvaluationReport& report) {
  const absl::StatusOr<std::vector<DrawnAction>> actions = ActionsOf(set, report);
  if (!actions.ok()) return actions.status();
  if (actions->empty() || report.sampled_examples().empty()) {
    return absl::InvalidArgumentError(
        "nothing to draw: there are no actions, or the report carries no examples");
  }
  std::map<int, std::vector<Points>> examples;  // by action
  Extent extent;
  for (const v1::EvaluatedExample& example : report.sampled_examples()) {
    auto points = PointsOf(example.trajectory(), "a trajectory of " + example.scenario_id());
    if (!points.ok()) return points.status();
    for (const scene::Point2& p : *points) extent.Include(p.x, p.y);
    examples[ActionOf(example)].push_back(*std::move(points));
  }
  for (const DrawnAction& action : *actions) {
    for (const scene::Point2& p : action.mean) extent.Include(p.x, p.y);
  }
  const double margin = 0.03 * (extent.max_x - extent.min_x) + 1.0;
  extent = {extent.min_x - margin, extent.max_x + margin, extent.min_y - margin,
            extent.max_y + margin};

  // As high as the extent needs, within limits.
  const double across = kMeansWidth - kLegend - 100.0;
  const double up = std::clamp(
      across * (extent.max_y - extent.min_y) / (extent.max_x - extent.min_x), 430.0, 1100.0);
  const int height = static_cast<int>(kMeansHeader + up + 64.0);
  Canvas canvas(kMeansWidth, height, kPaper);
  const Box box{76.0, kMeansHeader, across, up};
  const Axes axes(box, extent);
  const AxesStyle style{{120, 120, 120}, kFaintInk, {240, 240, 240}};
  canvas.ClipTo(box);
  axes.DrawGrid(style, &canvas);
  for (auto action = actions->rbegin(); action != actions->rend(); ++action) {
    for (const Points& points : examples[action->action->action_id()]) {
      canvas.Stroke(ToPixels(axes, points), action->color, 1.0, 0.42);
    }
  }
  DrawMeans(axes, *actions, &canvas);
  canvas.Disc(axes.ToPixel(0.0, 0.0), 4.5, kInk);
  canvas.ClipToAll();
  axes.DrawFrame(style, &canvas);
  const double horizon = set.waypoint_times().empty() ? 0.0 : *set.waypoint_times().rbegin();
  canvas.Text(absl::StrFormat("%s on %s", report.model_version(), report.dataset()), {76.0, 32.0},
              13.0, kInk, Anchor::kLeft, true);
  const std::string at =
      set.has_speed() ? absl::StrFormat(" from %g m/s straight on", set.speed()) : "";
  canvas.Text(absl::StrFormat("generic mean of each action (thick), %g s%s, over %d recorded "
                              "trajectories in the colour of the action that they most likely were",
                              horizon, at, report.sampled_examples_size()),
              {76.0, 56.0}, 10.0, kFaintInk);
  DrawLegend(*actions, {box.right() + 30.0, box.top, kLegend - 40.0, up}, &canvas);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawActionMeans(const v1::ActionSet& actions,
                                            const v1::EvaluationReport& report) {
  try {
    return PaintActionMeans(actions, report);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the action means: ", error.what()));
  }
}

}  // namespace maneuver::plot
