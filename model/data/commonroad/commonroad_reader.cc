#include "model/data/commonroad/commonroad_reader.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <map>
#include <optional>
#include <pugixml.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/data/commonroad/lanelet_map.h"
#include "model/data/recording_split.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

using pugi::xml_node;

constexpr double kPast = 1.0;          // seconds of a recording before its prediction time
constexpr int kMostSteps = 10'000;     // of a traffic light that are read
constexpr double kMostDuration = 1e9;  // of what a traffic light shows, steps
// What is checked here is checked again with the scenario. But a file of some kilobytes must not
// become gigabytes before that.
constexpr scene::ScenarioLimits kLimits;

// Reads elements and keeps the first error, wherever it is found. Throws nothing.
class Reading {
 public:
  bool ok() const { return problem_.empty(); }
  const std::string& problem() const { return problem_; }
  void Fail(const std::string& problem) {
    if (problem_.empty()) problem_ = problem;
  }

  // Reads a number: the text of `node`, which messages call `what`.
  double Number(const xml_node& node, const std::string& what) {
    double value = 0.0;
    if (!absl::SimpleAtod(node.text().as_string(), &value) || !std::isfinite(value)) {
      Fail(absl::StrCat(what, " is not a number"));
      return 0.0;
    }
    return value;
  }
  int64_t Id(const xml_node& node, const char* attribute, const std::string& what) {
    int64_t value = 0;
    if (!absl::SimpleAtoi(node.attribute(attribute).as_string(), &value)) {
      Fail(absl::StrCat(what, " has no whole number as its ", attribute));
    }
    return value;
  }
  // Reads <exact>, or the middle of an interval. Returns nothing if `node` does not exist.
  std::optional<double> Value(const xml_node& node, const std::string& what) {
    if (!node) return std::nullopt;
    if (const xml_node exact = node.child("exact")) return Number(exact, what);
    return 0.5 *
           (Number(node.child("intervalStart"), what) + Number(node.child("intervalEnd"), what));
  }
  MapPoint Point(const xml_node& node, const std::string& what) {
    return {Number(node.child("x"), what + ": x"), Number(node.child("y"), what + ": y")};
  }
  Polyline Points(const xml_node& node, const std::string& what) {
    Polyline points;
    for (const xml_node& point : node.children("point")) points.push_back(Point(point, what));
    return points;
  }

 private:
  std::string problem_;
};

v1::AgentType TypeOf(const std::string& type) {
  static const std::map<std::string, v1::AgentType> kTypes = {
      {"car", v1::AGENT_TYPE_VEHICLE},           {"truck", v1::AGENT_TYPE_VEHICLE},
      {"bus", v1::AGENT_TYPE_VEHICLE},           {"motorcycle", v1::AGENT_TYPE_VEHICLE},
      {"taxi", v1::AGENT_TYPE_VEHICLE},          {"priorityVehicle", v1::AGENT_TYPE_VEHICLE},
      {"parkedVehicle", v1::AGENT_TYPE_VEHICLE}, {"bicycle", v1::AGENT_TYPE_CYCLIST},
      {"pedestrian", v1::AGENT_TYPE_PEDESTRIAN}};
  const auto found = kTypes.find(type);
  return found == kTypes.end() ? v1::AGENT_TYPE_OTHER : found->second;
}

// The box around points, metres.
struct Box {
  double left = -HUGE_VAL, right = HUGE_VAL, back = HUGE_VAL, front = -HUGE_VAL;
  void Add(double x, double y) {
    back = std::min(back, x);
    front = std::max(front, x);
    right = std::min(right, y);
    left = std::max(left, y);
  }
  MapPoint Center() const { return {0.5 * (back + front), 0.5 * (right + left)}; }
};

// Sets the size of the box around a shape that is given relative to the obstacle's position.
// Returns the box's centre, relative to the same.
MapPoint AddShape(const xml_node& shape, const std::string& what, Reading& reading,
                  v1::Agent* agent) {
  Box box;
  for (const xml_node& part : shape.children()) {
    const std::string name = part.name();
    if (name == "rectangle") {
      const double length = reading.Number(part.child("length"), what + ": length");
      const double width = reading.Number(part.child("width"), what + ": width");
      const double turn = part.child("orientation")
                              ? reading.Number(part.child("orientation"), what + ": orientation")
                              : 0.0;
      const MapPoint center = part.child("center")
                                  ? reading.Point(part.child("center"), what + ": center")
                                  : MapPoint();
      for (const double along : {-0.5, 0.5}) {
        for (const double across : {-0.5, 0.5}) {
          const double x = along * length, y = across * width;
          box.Add(center.x + std::cos(turn) * x - std::sin(turn) * y,
                  center.y + std::sin(turn) * x + std::cos(turn) * y);
        }
      }
    } else if (name == "circle") {
      const double radius = reading.Number(part.child("radius"), what + ": radius");
      const MapPoint center = part.child("center")
                                  ? reading.Point(part.child("center"), what + ": center")
                                  : MapPoint();
      box.Add(center.x - radius, center.y - radius);
      box.Add(center.x + radius, center.y + radius);
    } else if (name == "polygon") {
      for (const MapPoint& point : reading.Points(part, what)) box.Add(point.x, point.y);
    }
  }
  if (!(box.front > box.back && box.left > box.right)) {
    reading.Fail(what + " has no extent");
    return {};
  }
  agent->set_length(box.front - box.back);
  agent->set_width(box.left - box.right);
  return box.Center();
}

// Returns the position of a state: a point, or the centre of an area. Returns nothing if it is
// given only by lanelets.
std::optional<MapPoint> PlaceOf(const xml_node& position, const std::string& what,
                                Reading& reading) {
  if (const xml_node point = position.child("point")) return reading.Point(point, what);
  for (const char* shape : {"rectangle", "circle"}) {
    if (const xml_node center = position.child(shape).child("center")) {
      return reading.Point(center, what);
    }
  }
  if (const xml_node polygon = position.child("polygon")) {
    Box box;
    for (const MapPoint& point : reading.Points(polygon, what)) box.Add(point.x, point.y);
    if (box.front >= box.back) return box.Center();
  }
  return std::nullopt;
}

//   center: of the obstacle's box, relative to its position
//   unmeasured: gets the state's number if its velocity is not stated
void AddState(const xml_node& state, double step, const MapPoint& center, const std::string& what,
              Reading& reading, v1::Agent* agent, std::vector<int>* unmeasured) {
  const std::optional<MapPoint> place =
      PlaceOf(state.child("position"), what + ": position", reading);
  if (!place) return;
  const std::optional<double> time = reading.Value(state.child("time"), what + ": time");
  const std::optional<double> heading =
      reading.Value(state.child("orientation"), what + ": orientation");
  if (!time) reading.Fail(what + " has no time");
  if (!heading) reading.Fail(what + " has no orientation");
  if (!time || !heading) return;
  const std::optional<double> speed = reading.Value(state.child("velocity"), what + ": velocity");
  if (!speed) unmeasured->push_back(agent->states_size());
  v1::AgentState* added = agent->add_states();
  added->set_time(*time * step);
  if (!std::isfinite(added->time())) reading.Fail(what + ": time is beyond any clock");
  added->set_x(place->x + std::cos(*heading) * center.x - std::sin(*heading) * center.y);
  added->set_y(place->y + std::sin(*heading) * center.x + std::cos(*heading) * center.y);
  added->set_heading(static_cast<float>(std::remainder(*heading, 2.0 * M_PI)));
  added->set_velocity_x(static_cast<float>(speed.value_or(0.0) * std::cos(*heading)));
  added->set_velocity_y(static_cast<float>(speed.value_or(0.0) * std::sin(*heading)));
  const int states = agent->states_size();
  if (states > 1 && added->time() <= agent->states(states - 2).time()) {
    reading.Fail(what + " must be later than the one before");
  }
}

// Gives the states `unmeasured` the velocity of the way from the state before; the first state has
// that of the way to the next one.
void MeasureVelocities(const std::vector<int>& unmeasured, v1::Agent* agent) {
  if (agent->states_size() < 2) return;
  for (const int i : unmeasured) {
    const v1::AgentState& from = agent->states(std::max(i - 1, 0));
    const v1::AgentState& to = agent->states(std::max(i, 1));
    const double time = to.time() - from.time();
    v1::AgentState* const state = agent->mutable_states(i);
    state->set_velocity_x(static_cast<float>((to.x() - from.x()) / time));
    state->set_velocity_y(static_cast<float>((to.y() - from.y()) / time));
  }
}

bool IsObstacle(const xml_node& node) {
  const std::string name = node.name();
  return name == "obstacle" || name == "dynamicObstacle" || name == "staticObstacle";
}

bool IsStatic(const xml_node& obstacle) {
  return std::string(obstacle.name()) == "staticObstacle" ||
         std::string(obstacle.child("role").text().as_string()) == "static";
}

void AddObstacles(const xml_node& root, double step, Reading& reading, v1::Scenario* scenario) {
  double last_step = 0.0;
  std::set<int64_t> standing;
  for (const xml_node& obstacle : root.children()) {
    if (!IsObstacle(obstacle)) continue;
    const std::string what = absl::StrCat("obstacle ", obstacle.attribute("id").as_string());
    v1::Agent agent;
    agent.set_id(reading.Id(obstacle, "id", what));
    agent.set_type(TypeOf(obstacle.child("type").text().as_string()));
    const xml_node shape =
        obstacle.child("shape") ? obstacle.child("shape") : obstacle.child("Shape");
    const MapPoint center = AddShape(shape, what + ": shape", reading, &agent);
    std::vector<int> unmeasured;
    AddState(obstacle.child("initialState"), step, center, what + ": initialState", reading, &agent,
             &unmeasured);
    for (const xml_node& state : obstacle.child("trajectory").children("state")) {
      AddState(state, step, center, what + ": state of its trajectory", reading, &agent,
               &unmeasured);
    }
    if (!reading.ok()) return;
    MeasureVelocities(unmeasured, &agent);
    if (agent.states().empty()) continue;
    if (scenario->agents_size() == kLimits.max_agents) {
      reading.Fail(absl::StrCat("more than ", kLimits.max_agents, " obstacles"));
      return;
    }
    last_step = std::max(last_step, std::round(agent.states().rbegin()->time() / step));
    if (IsStatic(obstacle)) standing.insert(agent.id());
    *scenario->add_agents() = std::move(agent);
  }
  for (v1::Agent& agent : *scenario->mutable_agents()) {
    if (!standing.contains(agent.id()) || agent.states_size() != 1) continue;
    const v1::AgentState stands = agent.states(0);
    const double first_step = std::round(stands.time() / step);
    const double left = last_step - first_step;  // no number if both are infinite
    const int most = kLimits.max_states_per_agent - 1;
    const int steps = left > 0.0 ? static_cast<int>(std::min<double>(left, most)) : 0;
    for (int i = 1; i <= steps; ++i) {
      *agent.add_states() = stands;
      agent.mutable_states()->rbegin()->set_time((first_step + i) * step);
    }
  }
}

Lanelet::Kind KindOf(const xml_node& lanelet) {
  Lanelet::Kind kind = Lanelet::Kind::kDriving;
  for (const xml_node& type : lanelet.children("laneletType")) {
    const std::string name = type.text().as_string();
    if (name == "crosswalk") return Lanelet::Kind::kCrosswalk;
    if (name == "sidewalk") kind = Lanelet::Kind::kSidewalk;
    if (name == "bicycleLane") kind = Lanelet::Kind::kBicycle;
  }
  return kind;
}

std::optional<int64_t> Beside(const xml_node& adjacent) {
  int64_t id = 0;
  if (!adjacent || !absl::SimpleAtoi(adjacent.attribute("ref").as_string(), &id)) {
    return std::nullopt;
  }
  return id;
}

// Returns the adjacent lanelet if it is driven in the same direction.
std::optional<int64_t> NeighborOf(const xml_node& adjacent) {
  const std::string direction = adjacent.attribute("drivingDir").as_string();
  return direction == "same" ? Beside(adjacent) : std::nullopt;
}

// Returns the ids that the elements of this name refer to.
std::vector<int64_t> References(const xml_node& lanelet, const char* name) {
  std::vector<int64_t> ids;
  for (const xml_node& element : lanelet.children(name)) {
    int64_t id = 0;
    if (absl::SimpleAtoi(element.attribute("ref").as_string(), &id)) ids.push_back(id);
  }
  return ids;
}

// Returns the speed limits of 2020a, by the id of the traffic sign that states them. The sign's
// additional value is in metres per second.
std::map<std::string, double> SpeedSigns(const xml_node& root) {
  static const std::set<std::string> kMaximumSpeed = {"274", "R2-1", "r301"};
  std::map<std::string, double> limits;
  for (const xml_node& sign : root.children("trafficSign")) {
    for (const xml_node& element : sign.children("trafficSignElement")) {
      double limit = 0.0;
      if (kMaximumSpeed.contains(element.child("trafficSignID").text().as_string()) &&
          absl::SimpleAtod(element.child("additionalValue").text().as_string(), &limit) &&
          limit > 0.0) {
        limits[sign.attribute("id").as_string()] = limit;
      }
    }
  }
  return limits;
}

std::vector<Lanelet> ReadLanelets(const xml_node& root, Reading& reading) {
  const std::map<std::string, double> signs = SpeedSigns(root);
  std::vector<Lanelet> lanelets;
  int64_t points_in_bounds = 0;
  for (const xml_node& node : root.children("lanelet")) {
    const std::string what = absl::StrCat("lanelet ", node.attribute("id").as_string());
    if (std::ssize(lanelets) == kLimits.max_map_features) {
      reading.Fail(absl::StrCat("more than ", kLimits.max_map_features, " lanelets"));
      return lanelets;
    }
    Lanelet& lanelet = lanelets.emplace_back();
    lanelet.id = reading.Id(node, "id", what);
    lanelet.kind = KindOf(node);
    lanelet.left = reading.Points(node.child("leftBound"), what + ": leftBound");
    lanelet.right = reading.Points(node.child("rightBound"), what + ": rightBound");
    if (lanelet.left.size() < 2 || lanelet.right.size() < 2) {
      reading.Fail(what + " must have bounds of two points or more");
      return lanelets;
    }
    // MapOf compares each piece of a bound with the points of others.
    points_in_bounds += std::ssize(lanelet.left) + std::ssize(lanelet.right);
    if (points_in_bounds > kLimits.max_map_points) {
      reading.Fail(absl::StrCat("more than ", kLimits.max_map_points, " points in bounds"));
      return lanelets;
    }
    lanelet.beside_left = Beside(node.child("adjacentLeft"));
    lanelet.beside_right = Beside(node.child("adjacentRight"));
    lanelet.neighbor_left = NeighborOf(node.child("adjacentLeft"));
    lanelet.neighbor_right = NeighborOf(node.child("adjacentRight"));
    lanelet.successors = References(node, "successor");
    lanelet.predecessors = References(node, "predecessor");
    if (const xml_node limit = node.child("speedLimit")) {
      lanelet.speed_limit = reading.Number(limit, what + ": speedLimit");
    }
    for (const xml_node& reference : node.children("trafficSignRef")) {
      const auto sign = signs.find(reference.attribute("ref").as_string());
      if (sign != signs.end()) lanelet.speed_limit = sign->second;
    }
    for (const xml_node& line : node.children("stopLine")) {
      const Polyline points = reading.Points(line, what + ": stopLine");
      // A stop line without points is at the lanelet's end.
      lanelet.stop_lines.push_back(
          points.size() >= 2 ? points : Polyline{lanelet.left.back(), lanelet.right.back()});
    }
  }
  return lanelets;
}

v1::TrafficSignalState StateOf(const std::string& color) {
  if (color == "red") return v1::TRAFFIC_SIGNAL_STATE_STOP;
  if (color == "yellow" || color == "redYellow") return v1::TRAFFIC_SIGNAL_STATE_CAUTION;
  return color == "green" ? v1::TRAFFIC_SIGNAL_STATE_GO : v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
}

// Returns what a light shows from step 0 to `last`: one reading per change.
std::vector<v1::TrafficSignalReading> ReadingsOf(const xml_node& light, int last, double step,
                                                 Reading& reading) {
  const std::string what = absl::StrCat("trafficLight ", light.attribute("id").as_string());
  std::vector<std::pair<int64_t, v1::TrafficSignalState>> cycle;  // duration in steps, state
  int64_t length = 0;
  for (const xml_node& element : light.child("cycle").children("cycleElement")) {
    const double duration = reading.Number(element.child("duration"), what + ": duration");
    if (!(duration >= 1.0 && duration <= kMostDuration)) {
      reading.Fail(absl::StrCat(what, ": duration must be 1 to ", kMostDuration, " steps"));
      return {};
    }
    cycle.emplace_back(static_cast<int64_t>(duration),
                       StateOf(element.child("color").text().as_string()));
    length += cycle.back().first;
  }
  std::vector<v1::TrafficSignalReading> readings;
  if (cycle.empty() || !reading.ok()) return readings;
  const bool active = light.child("active").text().as_bool(true);
  const int64_t offset = light.child("cycle").child("timeOffset").text().as_llong(0) % length;
  int64_t left = ((-offset % length) + length) % length;  // steps into the cycle, then into element
  size_t element = 0;
  while (left >= cycle[element].first) left -= cycle[element++].first;
  for (int64_t i = 0; i <= last;
       i += cycle[element].first - left, left = 0, element = (element + 1) % cycle.size()) {
    const v1::TrafficSignalState state =
        active ? cycle[element].second : v1::TRAFFIC_SIGNAL_STATE_UNSPECIFIED;
    if (!readings.empty() && readings.back().state() == state) continue;
    if (std::ssize(readings) == kLimits.max_readings_per_signal) {
      reading.Fail(
          absl::StrCat(what, " changes more than ", kLimits.max_readings_per_signal, " times"));
      return {};
    }
    readings.emplace_back().set_time(static_cast<double>(i) * step);
    readings.back().set_state(state);
  }
  return readings;
}

// Where a lane leads, in the words of a traffic light's direction. Points that repeat the one before
// have no direction.
std::string TurnOf(const v1::MapFeature& lane) {
  constexpr double kTurn = M_PI / 6.0;
  constexpr double kLeastSegment = 0.001;  // metres
  const auto along = [&lane](int i) {
    return MapPoint{lane.x(i + 1) - lane.x(i), lane.y(i + 1) - lane.y(i)};
  };
  const auto is_short = [&along](int i) {
    return std::hypot(along(i).x, along(i).y) <= kLeastSegment;
  };
  int first = 0, last = lane.x_size() - 2;
  while (first < last && is_short(first)) ++first;
  while (first < last && is_short(last)) --last;
  const double before = std::atan2(along(first).y, along(first).x);
  const double after = std::atan2(along(last).y, along(last).x);
  const double turn = std::remainder(after - before, 2.0 * M_PI);
  return turn > kTurn ? "left" : turn < -kTurn ? "right" : "straight";
}

// Returns the light, of those before a lane, that is for who drives on it: the first whose
// direction says so, otherwise the first for going straight, otherwise the first.
xml_node LightFor(const std::string& turn, const std::vector<xml_node>& lights) {
  for (const std::string& wanted : {turn, std::string("straight")}) {
    for (const xml_node& light : lights) {
      const std::string direction =
          absl::AsciiStrToLower(light.child("direction").text().as_string("all"));
      if (direction == "all" || direction.find(wanted) != direction.npos) return light;
    }
  }
  return lights.front();
}

// Adds what the lights show to the lanes after the lanelets that refer to them.
void AddSignals(const xml_node& root, double step, Reading& reading, v1::Scenario* scenario) {
  double end = 0.0;
  for (const v1::Agent& agent : scenario->agents()) {
    end = std::max(end, agent.states().rbegin()->time());
  }
  const int last = static_cast<int>(std::min<double>(std::round(end / step), kMostSteps));
  std::map<std::string, xml_node> lights;
  for (const xml_node& light : root.children("trafficLight")) {
    lights[light.attribute("id").as_string()] = light;
  }
  if (lights.empty()) return;
  std::map<int64_t, const v1::MapFeature*> lanes;
  for (const v1::MapFeature& feature : scenario->map_features()) {
    if (feature.id() != 0 && feature.x_size() >= 2) lanes.emplace(feature.id(), &feature);
  }
  std::map<std::string, std::vector<v1::TrafficSignalReading>> shown;  // by light
  std::set<std::pair<int64_t, std::string>> added;                     // lanes and their lights
  for (const xml_node& lanelet : root.children("lanelet")) {
    std::vector<xml_node> here;
    for (const xml_node& reference : lanelet.children("trafficLightRef")) {
      const auto found = lights.find(reference.attribute("ref").as_string());
      if (found != lights.end()) here.push_back(found->second);
    }
    const auto before = lanes.find(reading.Id(lanelet, "id", "lanelet"));
    if (here.empty() || before == lanes.end()) continue;
    for (const int64_t id : before->second->successor_ids()) {
      const auto lane = lanes.find(id);
      if (lane == lanes.end()) continue;
      const xml_node light = LightFor(TurnOf(*lane->second), here);
      const std::string light_id = light.attribute("id").as_string();
      if (!added.emplace(id, light_id).second) continue;
      if (!shown.contains(light_id)) shown[light_id] = ReadingsOf(light, last, step, reading);
      const std::vector<v1::TrafficSignalReading>& readings = shown[light_id];
      if (!reading.ok()) return;
      if (readings.empty()) continue;
      if (scenario->traffic_signals_size() == kLimits.max_traffic_signals) {
        reading.Fail(absl::StrCat("lights at more than ", kLimits.max_traffic_signals, " lanes"));
        return;
      }
      v1::TrafficSignal* const signal = scenario->add_traffic_signals();
      signal->set_lane_id(id);
      signal->mutable_readings()->Add(readings.begin(), readings.end());
    }
  }
}

absl::StatusOr<v1::Scenario> Read(const xml_node& root, std::string_view xml) {
  Reading reading;
  const double step = root.attribute("timeStepSize").as_double(0.0);
  if (!(step > 0.0 && std::isfinite(step)))
    return absl::InvalidArgumentError("commonRoad: timeStepSize must be positive");
  v1::Scenario scenario;
  const std::string id = root.attribute("benchmarkID").as_string();
  scenario.set_scenario_id(id.empty() ? IdFromContent(xml) : id);
  AddObstacles(root, step, reading, &scenario);
  if (reading.ok() && scenario.agents().empty()) reading.Fail("the scenario has no obstacles");
  const std::vector<Lanelet> lanelets = ReadLanelets(root, reading);
  if (reading.ok()) {
    for (v1::MapFeature& feature : MapOf(lanelets)) {
      *scenario.add_map_features() = std::move(feature);
    }
  }
  if (reading.ok()) AddSignals(root, step, reading, &scenario);
  if (!reading.ok()) return absl::InvalidArgumentError(reading.problem());

  double first = HUGE_VAL, last = 0.0;
  for (const v1::Agent& agent : scenario.agents()) {
    first = std::min(first, agent.states(0).time());
    last = std::max(last, agent.states().rbegin()->time());
  }
  scenario.set_prediction_time(std::min(first + kPast, last));
  return scenario;
}

}  // namespace

absl::StatusOr<v1::Scenario> ParseCommonRoad(std::string_view xml) {
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(xml.data(), xml.size());
  if (!parsed) {
    return absl::InvalidArgumentError(
        absl::StrCat("no XML: ", parsed.description(), " at byte ", parsed.offset));
  }
  const xml_node root = document.child("commonRoad");
  if (!root) return absl::InvalidArgumentError("no CommonRoad scenario: it has no <commonRoad>");
  const std::string version = root.attribute("commonRoadVersion").as_string();
  if (version != "2018b" && version != "2020a") {
    return absl::InvalidArgumentError(
        absl::StrCat("commonRoadVersion \"", version, "\" is not read here; 2018b and 2020a are"));
  }
  return Read(root, xml);
}

}  // namespace maneuver::data
