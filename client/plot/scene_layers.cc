#include "client/plot/scene_layers.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/scene/target_frame.h"

namespace maneuver::plot {
namespace {

constexpr double kOutOfSight = 0.5;  // seconds without a state
constexpr double kPast = 1.0;        // seconds of past that are drawn

bool InSight(const Line& line, const Box& box) {
  double left = 1e300;
  double right = -1e300;
  double top = 1e300;
  double bottom = -1e300;
  for (const Pixel& p : line) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  return left < box.right() && right > box.left && top < box.bottom() && bottom > box.top;
}

// The corners of an agent's box and the tip of its arrow, in the panel.
struct Body {
  Line box;
  Line arrow;
};

Body BodyOf(const ScenePanel& panel, const v1::Agent& agent, const v1::AgentState& state) {
  const scene::Pose2 X_WA(state.x(), state.y(), state.heading());
  const auto at = [&](double ahead, double left) {
    const scene::Point2 p_WP = X_WA * scene::Point2{ahead * agent.length(), left * agent.width()};
    return panel.FromWorld(p_WP.x, p_WP.y);
  };
  return {{at(0.5, 0.5), at(0.5, -0.5), at(-0.5, -0.5), at(-0.5, 0.5)},
          {at(0.42, 0.0), at(0.12, 0.34), at(0.12, -0.34)}};
}

Line Closed(Line line) {
  line.push_back(line.front());
  return line;
}

// Returns the past second of an agent, ending at its state `now`.
Line Past(const ScenePanel& panel, const v1::Agent& agent, int now) {
  Line line;
  for (int i = 0; i <= now; ++i) {
    const v1::AgentState& state = agent.states(i);
    if (state.time() < agent.states(now).time() - kPast - scene::kSameTime) continue;
    line.push_back(panel.FromWorld(state.x(), state.y()));
  }
  return line;
}

Color LightColor(v1::TrafficSignalState state) {
  switch (state) {
    case v1::TRAFFIC_SIGNAL_STATE_STOP:
      return {255, 70, 60};
    case v1::TRAFFIC_SIGNAL_STATE_CAUTION:
      return {255, 190, 40};
    case v1::TRAFFIC_SIGNAL_STATE_GO:
      return {70, 220, 110};
    default:
      return {120, 120, 120};
  }
}

// Returns a circle around a point, as a line.
Line Ring(const Pixel& center, double radius) {
  constexpr int kCorners = 32;
  Line ring;
  for (int i = 0; i <= kCorners; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / kCorners;
    ring.push_back({center.x + radius * std::cos(angle), center.y + radius * std::sin(angle)});
  }
  return ring;
}

// Returns an arrowhead at the end of a line of at least two points, `size` pixels long. Empty if
// the last two points are equal.
Line Arrowhead(const Line& line, double size) {
  const Pixel tip = line.back();
  const Pixel from = line[line.size() - 2];
  const double length = std::hypot(tip.x - from.x, tip.y - from.y);
  if (length == 0.0) return {};
  const double dx = size * (tip.x - from.x) / length;
  const double dy = size * (tip.y - from.y) / length;
  return {{tip.x + dx, tip.y + dy},
          {tip.x - 0.5 * dy, tip.y + 0.5 * dx},
          {tip.x + 0.5 * dy, tip.y - 0.5 * dx}};
}

}  // namespace

int StateNow(const v1::Agent& agent, double prediction_time) {
  return scene::FindState(agent, prediction_time, kOutOfSight, prediction_time + scene::kSameTime);
}

void DrawMap(const ScenePanel& panel, Canvas* canvas) {
  std::vector<Line> lanes;
  std::vector<Line> bike_lanes;
  std::vector<Line> road_lines;
  std::vector<Line> edges;
  std::vector<Line> areas;
  std::vector<Line> stop_lines;
  for (const v1::MapFeature& feature : panel.scenario->map_features()) {
    Line line;
    const int count = std::min(feature.x_size(), feature.y_size());
    for (int i = 0; i < count; ++i) line.push_back(panel.FromWorld(feature.x(i), feature.y(i)));
    if (line.empty() || !InSight(line, panel.axes.box())) continue;
    switch (feature.type()) {
      case v1::MAP_FEATURE_TYPE_LANE_CENTERLINE:
        lanes.push_back(std::move(line));
        break;
      case v1::MAP_FEATURE_TYPE_BIKE_LANE:
        bike_lanes.push_back(std::move(line));
        break;
      case v1::MAP_FEATURE_TYPE_ROAD_LINE:
        road_lines.push_back(std::move(line));
        break;
      case v1::MAP_FEATURE_TYPE_ROAD_EDGE:
        edges.push_back(std::move(line));
        break;
      case v1::MAP_FEATURE_TYPE_STOP_LINE:
        stop_lines.push_back(std::move(line));
        break;
      case v1::MAP_FEATURE_TYPE_CROSSWALK:
      case v1::MAP_FEATURE_TYPE_SPEED_BUMP:
      case v1::MAP_FEATURE_TYPE_DRIVEWAY:
        areas.push_back(std::move(line));
        break;
      default:
        break;
    }
  }
  canvas->Polygons(areas, kArea, 0.13);
  canvas->Strokes(road_lines, kRoadLine, 1.0);
  canvas->Strokes(edges, kRoadEdge, 2.0);
  canvas->Strokes(bike_lanes, {70, 92, 88}, 1.0);
  canvas->Strokes(lanes, kLane, 1.4);
  canvas->Strokes(stop_lines, {170, 170, 176}, 2.0, 0.6);
}

void DrawSignals(const ScenePanel& panel, Canvas* canvas) {
  for (const v1::TrafficSignal& signal : panel.scenario->traffic_signals()) {
    const v1::TrafficSignalReading* const reading =
        scene::LatestReading(signal, panel.scenario->prediction_time());
    const Color color =
        LightColor(reading == nullptr ? v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED : reading->state());
    for (const v1::MapFeature& lane : panel.scenario->map_features()) {
      if (lane.id() != signal.lane_id() || lane.x().empty() || lane.y().empty()) continue;
      if (lane.type() != v1::MAP_FEATURE_TYPE_LANE_CENTERLINE) continue;
      canvas->Disc(panel.FromWorld(lane.x(0), lane.y(0)), 4.0, color, 0.9);
    }
  }
}

void DrawLanePaths(const ScenePanel& panel, const std::vector<scene::LanePath>& paths,
                   Canvas* canvas) {
  std::vector<Line> lines;
  std::vector<Line> heads;
  for (const scene::LanePath& path : paths) {
    Line line;
    for (const scene::Point2& point : path.points)
      line.push_back(panel.FromWorld(point.x, point.y));
    if (Line head = Arrowhead(line, 11.0); !head.empty()) heads.push_back(std::move(head));
    lines.push_back(std::move(line));
  }
  canvas->Strokes(lines, kLanePath, 7.0, 0.3);
  canvas->Strokes(lines, kLanePath, 2.0, 0.9);
  canvas->Polygons(heads, kLanePath, 0.9);
  for (const scene::LanePath& path : paths) {
    if (path.signal) {
      const Pixel center = panel.FromWorld(path.signal->x, path.signal->y);
      canvas->Disc(center, 5.0, LightColor(path.signal_state));
      canvas->Stroke(Ring(center, 8.0), kLanePath, 1.6);
    }
    if (path.stop_sign) {
      const Pixel center = panel.FromWorld(path.stop_sign->x, path.stop_sign->y);
      canvas->Disc(center, 6.0, {200, 30, 40});
      canvas->Stroke(Ring(center, 6.0), {240, 240, 240}, 1.6);
    }
  }
}

void DrawLeaders(const ScenePanel& panel, const std::vector<scene::LanePath>& paths,
                 Canvas* canvas) {
  for (const scene::LanePath& path : paths) {
    if (!path.leader) continue;
    const double radius = std::max(12.0, 3.2 * panel.axes.pixels_per_meter());
    canvas->Stroke(Ring(panel.FromWorld(path.leader->x, path.leader->y), radius), kLanePath, 2.2);
  }
}

void DrawOtherAgents(const ScenePanel& panel, int64_t target_id, Canvas* canvas) {
  std::vector<Line> pasts;
  std::vector<Line> fills;
  std::vector<Line> outlines;
  std::vector<Line> arrows;
  for (const v1::Agent& agent : panel.scenario->agents()) {
    const int now = StateNow(agent, panel.scenario->prediction_time());
    if (agent.id() == target_id || now < 0) continue;
    Body body = BodyOf(panel, agent, agent.states(now));
    pasts.push_back(Past(panel, agent, now));
    if (!InSight(body.box, panel.axes.box())) continue;
    outlines.push_back(Closed(body.box));
    fills.push_back(std::move(body.box));
    arrows.push_back(std::move(body.arrow));
  }
  canvas->Strokes(pasts, kOtherAgent, 1.2, 0.45);
  canvas->Polygons(fills, kOtherAgent, 0.45);
  canvas->Strokes(outlines, kOtherAgent, 1.2);
  canvas->Polygons(arrows, {255, 190, 185}, 0.9);
}

void DrawTarget(const ScenePanel& panel, const v1::Agent& target, Canvas* canvas) {
  const int now = StateNow(target, panel.scenario->prediction_time());
  if (now < 0) return;
  const Body body = BodyOf(panel, target, target.states(now));
  canvas->Stroke(Past(panel, target, now), kTarget, 2.2, 0.8);
  canvas->Polygons({body.box}, kTarget, 0.9);
  canvas->Stroke(Closed(body.box), {255, 240, 170}, 1.4);
  canvas->Polygons({body.arrow}, kGround, 0.85);
}

Line TruthLine(const ScenePanel& panel, const v1::Agent& agent, double horizon) {
  const int now = StateNow(agent, panel.scenario->prediction_time());
  Line line;
  if (now < 0) return line;
  const double end =
      horizon > 0.0 ? panel.scenario->prediction_time() + horizon + scene::kSameTime : 1e300;
  for (int i = now; i < agent.states_size() && agent.states(i).time() <= end; ++i) {
    line.push_back(panel.FromWorld(agent.states(i).x(), agent.states(i).y()));
  }
  return line.size() > 1 ? line : Line();
}

}  // namespace maneuver::plot
