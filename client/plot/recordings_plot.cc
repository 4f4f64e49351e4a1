#include "client/plot/recordings_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
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

constexpr double kPanelHeader = 44.0;
constexpr double kPanelMargin = 16.0;
constexpr double kTickMargin = 42.0;
constexpr double kLegendHeight = 40.0;
constexpr double kMoves = 1.0;  // metres of path

struct PathStyle {
  v1::AgentType type;
  Color color;
  const char* name;
};
constexpr std::array<PathStyle, 3> kPaths = {{
    {v1::AGENT_TYPE_VEHICLE, {240, 240, 244}, "vehicle's path"},
    {v1::AGENT_TYPE_PEDESTRIAN, {80, 200, 255}, "pedestrian's path"},
    {v1::AGENT_TYPE_CYCLIST, {120, 230, 130}, "cyclist's path"},
}};

double PathLength(const Line& line) {
  double length = 0.0;
  for (size_t i = 1; i < line.size(); ++i) {
    length += std::hypot(line[i].x - line[i - 1].x, line[i].y - line[i - 1].y);
  }
  return length;
}

bool SomebodyIsInSight(const v1::Scenario& recording) {
  return std::ranges::any_of(recording.agents(), [&](const v1::Agent& agent) {
    return StateNow(agent, recording.prediction_time()) >= 0;
  });
}

// Returns the recording at a time with at least one agent.
v1::Scenario AtATimeToLookAt(const v1::Scenario& recording) {
  v1::Scenario seen = recording;
  if (SomebodyIsInSight(seen)) return seen;
  double first = HUGE_VAL;
  double last = -HUGE_VAL;
  for (const v1::Agent& agent : recording.agents()) {
    if (agent.states().empty()) continue;
    first = std::min(first, agent.states().begin()->time());
    last = std::max(last, agent.states().rbegin()->time());
  }
  if (first <= last) seen.set_prediction_time((first + last) / 2.0);
  return seen;
}

// Returns the middle of the visible targets; without any, of the vehicles; without any, of all
// agents.
std::optional<scene::Point2> MiddleOf(const v1::Scenario& recording) {
  for (const int choice : {0, 1, 2}) {
    scene::Point2 sum{0.0, 0.0};
    int count = 0;
    for (const v1::Agent& agent : recording.agents()) {
      const int now = StateNow(agent, recording.prediction_time());
      const bool is_target =
          std::ranges::find(recording.target_ids(), agent.id()) != recording.target_ids().end();
      const bool counts =
          choice == 2 || (choice == 0 ? is_target : agent.type() == v1::AGENT_TYPE_VEHICLE);
      if (now < 0 || !counts) continue;
      sum.x += agent.states(now).x();
      sum.y += agent.states(now).y();
      ++count;
    }
    if (count > 0) return scene::Point2{sum.x / count, sum.y / count};
  }
  return std::nullopt;
}

void DrawPaths(const ScenePanel& panel, double horizon, Canvas* canvas) {
  for (const PathStyle& style : kPaths) {
    std::vector<Line> paths;
    for (const v1::Agent& agent : panel.scenario->agents()) {
      if (agent.type() != style.type) continue;
      Line path = TruthLine(panel, agent, horizon);
      if (PathLength(path) < kMoves * panel.axes.pixels_per_meter()) continue;
      paths.push_back(std::move(path));
    }
    canvas->Strokes(paths, kGround, 4.0, 0.6);
    canvas->Strokes(paths, style.color, 1.8, 0.9);
    for (const Line& path : paths) canvas->Disc(path.back(), 2.6, style.color);
  }
}

void DrawPanel(const v1::Scenario& recording, const scene::Point2& middle, const Box& cell,
               const RecordingsPlotOptions& options, Canvas* canvas) {
  const Box box{cell.left + kTickMargin, cell.top + kPanelHeader,
                cell.width - kTickMargin - kPanelMargin, cell.height - kPanelHeader - kTickMargin};
  const double half_width = options.extent / 2.0;
  const double half_height = half_width * box.height / box.width;
  const ScenePanel panel{&recording, scene::Pose2(middle.x, middle.y, 0.0),
                         Axes(box, {-half_width, half_width, -half_height, half_height})};
  AxesStyle axes{{96, 99, 107}, kFaintText, {31, 34, 40}};
  axes.titles = false;
  canvas->ClipTo(box);
  panel.axes.DrawGrid(axes, canvas);
  DrawMap(panel, canvas);
  DrawSignals(panel, canvas);
  DrawPaths(panel, options.horizon, canvas);
  // Draws agents over their paths. No agent has the smallest id, so none is left out.
  DrawOtherAgents(panel, INT64_MIN, canvas);
  for (const v1::Agent& agent : recording.agents()) {
    const auto& targets = recording.target_ids();
    if (agent.type() != v1::AGENT_TYPE_VEHICLE) continue;
    if (std::ranges::find(targets, agent.id()) != targets.end()) DrawTarget(panel, agent, canvas);
  }
  canvas->ClipToAll();
  panel.axes.DrawFrame(axes, canvas);
  canvas->Text(recording.scenario_id(), {box.left, cell.top + 30.0}, 11.0, kText, Anchor::kLeft,
               true);
  const auto vehicles = std::ranges::count_if(recording.agents(), [](const v1::Agent& agent) {
    return agent.type() == v1::AGENT_TYPE_VEHICLE;
  });
  canvas->Text(absl::StrFormat("t = %.1f s   %d vehicles, %d others", recording.prediction_time(),
                               vehicles, recording.agents_size() - vehicles),
               {box.right(), cell.top + 30.0}, 9.0, kFaintText, Anchor::kRight);
}

void DrawLegend(double horizon, double top, Canvas* canvas) {
  double x = kTickMargin;
  const double y = top + kLegendHeight / 2.0 - 6.0;
  const auto entry = [&](Color color, double width, const std::string& text) {
    canvas->Stroke({{x, y}, {x + 26.0, y}}, color, width);
    canvas->Text(text, {x + 34.0, y + 4.5}, 9.0, kFaintText);
    x += 34.0 + Canvas::TextWidth(text, 9.0) + 30.0;
  };
  entry(kTarget, 8.0, "target");
  entry(kOtherAgent, 8.0, "other agent");
  const std::string reach =
      horizon > 0.0 ? absl::StrFormat(", the next %g s", horizon) : std::string();
  for (const PathStyle& style : kPaths) entry(style.color, 2.0, absl::StrCat(style.name, reach));
  entry(kLane, 2.0, "lane centreline");
}

absl::StatusOr<std::string> PaintRecordings(std::span<const v1::Scenario> recordings,
                                            const RecordingsPlotOptions& options) {
  struct Seen {
    v1::Scenario recording;
    scene::Point2 middle;
  };
  std::vector<Seen> all;
  for (const v1::Scenario& recording : recordings) {
    v1::Scenario seen = AtATimeToLookAt(recording);
    const auto middle = MiddleOf(seen);
    if (middle) all.push_back({std::move(seen), *middle});
  }
  if (all.empty()) {
    return absl::InvalidArgumentError("nothing to draw: nobody is in sight in any recording");
  }
  const GridShape grid = ShapeOf(static_cast<int>(all.size()));
  const int width = options.width > 0 ? options.width : std::max(1'100, 720 * grid.columns);
  const int height =
      options.height > 0 ? options.height : 620 * grid.rows + static_cast<int>(kLegendHeight);
  if (absl::Status status = CheckSize(width, height); !status.ok()) return status;
  Canvas canvas(width, height, {15, 16, 20});
  const Box whole{0.0, 0.0, double(width), double(height) - kLegendHeight};
  for (size_t i = 0; i < all.size(); ++i) {
    DrawPanel(all[i].recording, all[i].middle, CellOf(grid, static_cast<int>(i), whole), options,
              &canvas);
  }
  DrawLegend(options.horizon, whole.bottom(), &canvas);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawRecordings(std::span<const v1::Scenario> recordings,
                                           const RecordingsPlotOptions& options) {
  try {
    return PaintRecordings(recordings, options);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the recordings: ", error.what()));
  }
}

}  // namespace maneuver::plot
