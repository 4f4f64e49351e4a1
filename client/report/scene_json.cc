#include "client/report/scene_json.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::report {
namespace {

using nlohmann::json;
using scene::Point2;

constexpr double kPast = 1.0;            // seconds before the prediction time
constexpr double kSlack = 1e-6;          // seconds, for rounding
constexpr double kStateInterval = 0.19;  // seconds: of recordings at 10 Hz, every other state
constexpr double kMargin = 35.0;         // metres around what target and actions reach
constexpr double kViewShape = 1.5;       // width by height
constexpr double kTolerance = 0.12;      // metres that a simplified line may be off
constexpr double kStill = 0.3;           // metres; an agent that moves less has one state
constexpr size_t kMostAgents = 80;
constexpr int kMapDigits = 1;
constexpr int kDigits = 2;

// What the page shows of the plane, target frame, metres.
struct Window {
  double left = 0.0;
  double right = 0.0;
  double bottom = 0.0;
  double top = 0.0;

  void Include(double x, double y) {
    left = std::min(left, x);
    right = std::max(right, x);
    bottom = std::min(bottom, y);
    top = std::max(top, y);
  }
  bool Holds(const Point2& p) const {
    return p.x >= left && p.x <= right && p.y >= bottom && p.y <= top;
  }
};

void Include(const v1::Trajectory& trajectory, Window* window) {
  for (int t = 0; t < std::min(trajectory.x_size(), trajectory.y_size()); ++t) {
    window->Include(trajectory.x(t), trajectory.y(t));
  }
}

Window WindowOf(const Scene& scene) {
  Window window;
  Include(scene.truth, &window);
  for (const v1::ActionDistribution& action : scene.prediction.distributions()) {
    Include(action.mean_trajectory(), &window);
  }
  window = {window.left - kMargin, window.right + kMargin, window.bottom - kMargin,
            window.top + kMargin};
  // The view is wider than it is high, and x is upwards there.
  const double narrow = kViewShape * (window.right - window.left) - (window.top - window.bottom);
  if (narrow > 0.0) {
    window.bottom -= narrow / 2.0;
    window.top += narrow / 2.0;
  }
  return window;
}

double DistanceToSegment(const Point2& p, const Point2& a, const Point2& b) {
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  const double length = dx * dx + dy * dy;
  const double share =
      length > 0.0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / length, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - share * dx, p.y - a.y - share * dy);
}

// Keeps the points between `first` and `last` that are needed (Douglas and Peucker, 1973).
void Simplify(const std::vector<Point2>& line, size_t first, size_t last, std::vector<bool>* keep) {
  double furthest = kTolerance;
  size_t split = first;
  for (size_t i = first + 1; i < last; ++i) {
    const double distance = DistanceToSegment(line[i], line[first], line[last]);
    if (distance <= furthest) continue;
    furthest = distance;
    split = i;
  }
  if (split == first) return;
  (*keep)[split] = true;
  Simplify(line, first, split, keep);
  Simplify(line, split, last, keep);
}

json LineJson(const std::vector<Point2>& line) {
  std::vector<bool> keep(line.size(), false);
  keep.front() = true;
  keep.back() = true;
  Simplify(line, 0, line.size() - 1, &keep);
  json points = json::array();
  for (size_t i = 0; i < line.size(); ++i) {
    if (!keep[i]) continue;
    points.push_back(Rounded(line[i].x, kMapDigits));
    points.push_back(Rounded(line[i].y, kMapDigits));
  }
  return points;
}

// Returns whether a part of the segment from `a` to `b` is in the window (Liang and Barsky, 1984).
bool Crosses(const Point2& a, const Point2& b, const Window& window) {
  double first = 0.0;  // shares of the segment between which it is inside
  double last = 1.0;
  const auto cut = [&](double from, double step, double low, double high) {
    if (step == 0.0) return from >= low && from <= high;
    const auto [in, out] = std::minmax({(low - from) / step, (high - from) / step});
    first = std::max(first, in);
    last = std::min(last, out);
    return first <= last;
  };
  return cut(a.x, b.x - a.x, window.left, window.right) &&
         cut(a.y, b.y - a.y, window.bottom, window.top);
}

const char* MapKind(v1::MapFeatureType type) {
  switch (type) {
    case v1::MAP_FEATURE_TYPE_LANE_CENTERLINE:
      return "lane";
    case v1::MAP_FEATURE_TYPE_BIKE_LANE:
      return "bike";
    case v1::MAP_FEATURE_TYPE_ROAD_LINE:
      return "line";
    case v1::MAP_FEATURE_TYPE_ROAD_EDGE:
      return "edge";
    case v1::MAP_FEATURE_TYPE_STOP_LINE:
      return "stop";
    case v1::MAP_FEATURE_TYPE_STOP_SIGN:
      return "sign";
    default:
      return "area";
  }
}

// Lines in sight by kind: {"lane": [[x, y, ...], ...], "area": ...}. Areas are whole and closed,
// lines are cut to the runs of segments that are in sight.
json MapJson(const Scene& scene, const Window& window) {
  json map = json::object();
  for (const v1::MapFeature& feature : scene.recording->map_features()) {
    std::vector<Point2> line;
    const int points = std::min(feature.x_size(), feature.y_size());
    for (int i = 0; i < points; ++i) {
      line.push_back(scene.X_WT.ToLocal({feature.x(i), feature.y(i)}));
    }
    if (line.empty()) continue;
    const std::string kind = MapKind(feature.type());
    const bool is_whole = kind == "area" || kind == "sign";
    // Segment i begins at point i. The last one of an area ends at its first point; a single point
    // is a segment to itself.
    const size_t segments = is_whole || line.size() == 1 ? line.size() : line.size() - 1;
    const auto in_sight = [&](size_t i) {
      return Crosses(line[i], line[(i + 1) % line.size()], window);
    };
    for (size_t i = 0; i < segments; ++i) {
      if (!in_sight(i)) continue;
      if (is_whole) {
        map[kind].push_back(LineJson(line));
        break;
      }
      const size_t first = i;
      while (i + 1 < segments && in_sight(i + 1)) ++i;
      const size_t end = std::min(i + 2, line.size());
      map[kind].push_back(LineJson({line.begin() + static_cast<std::ptrdiff_t>(first),
                                    line.begin() + static_cast<std::ptrdiff_t>(end)}));
    }
  }
  return map;
}

const char* AgentKind(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_PEDESTRIAN:
      return "pedestrian";
    case v1::AGENT_TYPE_CYCLIST:
      return "cyclist";
    case v1::AGENT_TYPE_VEHICLE:
      return "vehicle";
    default:
      return "other";
  }
}

// States as [time, x, y, heading, ...], the time counted from the prediction time.
json StatesJson(const Scene& scene, const v1::Agent& agent, const Window& window, double horizon) {
  json states = json::array();
  double previous = -1e300;
  bool seen = false;
  bool moves = false;
  Point2 first;
  for (const v1::AgentState& state : agent.states()) {
    const double time = state.time() - scene.time;
    if (time < -kPast - kSlack || time > horizon + kSlack) continue;
    if (time - previous < kStateInterval && std::abs(time) > kSlack) continue;
    previous = time;
    const Point2 p = scene.X_WT.ToLocal({state.x(), state.y()});
    if (states.empty()) first = p;
    seen = seen || window.Holds(p);
    moves = moves || std::hypot(p.x - first.x, p.y - first.y) > kStill;
    const double heading =
        std::remainder(state.heading() - scene.X_WT.heading(), 2.0 * std::numbers::pi);
    for (const double value : {time, p.x, p.y, heading}) states.push_back(Rounded(value, kDigits));
  }
  if (!seen) return json::array();
  // One who stands is drawn once, for as long as it is in sight.
  if (!moves && states.size() > 8) states.erase(states.begin() + 4, states.end() - 4);
  return states;
}

json AgentsJson(const Scene& scene, const Window& window, double horizon) {
  std::vector<std::pair<double, json>> near;  // by distance at first sight, the target first
  for (const v1::Agent& agent : scene.recording->agents()) {
    json states = StatesJson(scene, agent, window, horizon);
    if (states.empty()) continue;
    const bool is_target = agent.id() == scene.target_id;
    const double distance =
        is_target ? -1.0 : std::hypot(states[1].get<double>(), states[2].get<double>());
    json entry = {{"id", absl::StrCat(agent.id())},
                  {"kind", AgentKind(agent.type())},
                  {"length", Rounded(agent.length(), 1)},
                  {"width", Rounded(agent.width(), 1)},
                  {"states", std::move(states)}};
    near.emplace_back(distance, std::move(entry));
  }
  std::ranges::stable_sort(near, {}, [](const auto& entry) { return entry.first; });
  if (near.size() > kMostAgents) near.resize(kMostAgents);
  json agents = json::array();
  for (auto& [distance, entry] : near) agents.push_back(std::move(entry));
  return agents;
}

// Where each signal stands, at the start of its lane: {"x", "y", "states": [time, light]}.
// Lights: 1 red, 2 yellow, 3 green, 0 not known.
json SignalsJson(const Scene& scene, const Window& window) {
  std::map<int64_t, const v1::MapFeature*> lanes;
  for (const v1::MapFeature& feature : scene.recording->map_features()) {
    if (!feature.x().empty() && feature.x_size() == feature.y_size()) {
      lanes[feature.id()] = &feature;
    }
  }
  json signals = json::array();
  for (const v1::TrafficSignal& signal : scene.recording->traffic_signals()) {
    const auto lane = lanes.find(signal.lane_id());
    if (lane == lanes.end()) continue;
    const Point2 p = scene.X_WT.ToLocal({lane->second->x(0), lane->second->y(0)});
    if (!window.Holds(p)) continue;
    json states = json::array();
    int light = -1;
    for (const v1::TrafficSignalReading& reading : signal.readings()) {
      if (reading.state() == light) continue;
      light = reading.state();
      states.push_back(Rounded(reading.time() - scene.time, kDigits));
      states.push_back(light);
    }
    signals.push_back({{"x", Rounded(p.x, kMapDigits)},
                       {"y", Rounded(p.y, kMapDigits)},
                       {"states", std::move(states)}});
  }
  return signals;
}

}  // namespace

double Rounded(double value, int digits) {
  const double scale = std::pow(10.0, digits);
  const double rounded = std::round(value * scale) / scale;
  return rounded == 0.0 ? 0.0 : rounded;  // not -0
}

json PointsJson(const v1::Trajectory& trajectory, const std::vector<int>& waypoints) {
  json points = json::array();
  for (const int t : waypoints) {
    if (t >= trajectory.x_size() || t >= trajectory.y_size()) break;
    points.push_back(Rounded(trajectory.x(t), kDigits));
    points.push_back(Rounded(trajectory.y(t), kDigits));
  }
  return points;
}

json DistributionJson(const v1::ActionDistribution& distribution,
                      const std::vector<int>& waypoints) {
  json covariance = json::array();
  const v1::WaypointMoments& moments = distribution.moments();
  for (const int t : waypoints) {
    if (t >= moments.covariance_xx_size() || t >= moments.covariance_xy_size() ||
        t >= moments.covariance_yy_size()) {
      break;
    }
    for (const double value :
         {moments.covariance_xx(t), moments.covariance_xy(t), moments.covariance_yy(t)}) {
      covariance.push_back(Rounded(value, 3));
    }
  }
  return {{"id", distribution.action_id()},
          {"p", Rounded(distribution.probability(), 4)},
          {"mean", PointsJson(distribution.mean_trajectory(), waypoints)},
          {"cov", std::move(covariance)}};
}

json SceneJson(const Scene& scene, const std::vector<int>& waypoints, double horizon) {
  const Window window = WindowOf(scene);
  json probabilities = json::array();
  for (const double p : scene.prediction.probabilities()) probabilities.push_back(Rounded(p, 4));
  json responsibilities = json::array();
  for (const double q : scene.responsibilities) responsibilities.push_back(Rounded(q, 4));
  json actions = json::array();
  for (const v1::ActionDistribution& action : scene.prediction.distributions()) {
    actions.push_back(DistributionJson(action, waypoints));
  }
  return {{"id", scene.recording->scenario_id()},
          {"target", absl::StrCat(scene.target_id)},
          {"time", Rounded(scene.time, 3)},
          {"speed", Rounded(scene.speed, 2)},
          {"class", scene.kinematic_class},
          {"groups", scene.groups},
          {"ade1", Rounded(scene.ade_1, 3)},
          {"minAde6", Rounded(scene.min_ade_6, 3)},
          {"surprise", Rounded(scene.surprise, 3)},
          {"p", std::move(probabilities)},
          {"q", std::move(responsibilities)},
          {"truth", PointsJson(scene.truth, waypoints)},
          {"actions", std::move(actions)},
          {"map", MapJson(scene, window)},
          {"agents", AgentsJson(scene, window, horizon)},
          {"signals", SignalsJson(scene, window)}};
}

}  // namespace maneuver::report
