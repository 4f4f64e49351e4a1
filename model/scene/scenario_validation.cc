#include "model/scene/scenario_validation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/utf8.h"
#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

using absl::StrCat;

// Collects violations up to a limit. Builds paths and messages only for what is wrong.
class Violations {
 public:
  explicit Violations(int limit) : limit_(std::max(limit, 1)) {}

  bool full() const { return static_cast<int>(found_.size()) >= limit_; }
  void Add(std::string field, std::string description) {
    if (!full()) found_.push_back({std::move(field), std::move(description)});
  }
  std::vector<FieldViolation> Take() { return std::move(found_); }

 private:
  const int limit_;
  std::vector<FieldViolation> found_;
};

std::string Element(const char* field, int index) { return StrCat(field, "[", index, "]"); }

std::string Member(const std::string& message, const char* field) {
  return StrCat(message, ".", field);
}

// Returns the number of code points in a UTF-8 string.
int Characters(const std::string& text) {
  return static_cast<int>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

// Returns false also for NaN and infinities.
bool Within(double value, double limit) { return std::abs(value) <= limit; }

// Prints twelve digits: times may count from 1970.
std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.12g", value);
  return text;
}

std::string NotFinite(double value) {
  return StrCat("is ", Number(value), "; must be a finite number");
}

std::string OutOfCoordinates(double value, double limit) {
  if (!std::isfinite(value)) return NotFinite(value);
  return StrCat("is ", Number(value), " m; must lie within ", Number(limit), " m of the origin");
}

// Describes a quantity in `unit` that is not finite or not within `low` .. `high`.
std::string OutOfRange(double value, double low, double high, const char* unit) {
  if (!std::isfinite(value)) return NotFinite(value);
  return StrCat("is ", Number(value), " ", unit, "; must lie within ", Number(low), " and ",
                Number(high), " ", unit);
}

bool CheckCount(std::string_view field, int count, int limit, Violations* violations) {
  if (count <= limit) return true;
  violations->Add(std::string(field),
                  StrCat("has ", count, " elements; at most ", limit, " are accepted"));
  return false;
}

void CheckSize(const std::string& agent, const char* field, double size, double limit,
               Violations* violations) {
  if (size > 0.0 && size <= limit) return;
  violations->Add(
      Member(agent, field),
      std::isfinite(size)
          ? StrCat("is ", Number(size), " m; must be greater than 0 and at most ", limit, " m")
          : NotFinite(size));
}

// Checks the times of states or of readings.
template <typename Timed>
bool TimeIsGood(const Timed& elements, int index, const ScenarioLimits& limits) {
  const double time = elements[index].time();
  return Within(time, limits.max_time) && (index == 0 || time > elements[index - 1].time());
}

template <typename Timed>
std::string BadTime(const Timed& elements, int index, const ScenarioLimits& limits) {
  const double time = elements[index].time();
  if (!Within(time, limits.max_time)) {
    return OutOfRange(time, -limits.max_time, limits.max_time, "s");
  }
  return StrCat("is ", Number(time), " s, not after the ", Number(elements[index - 1].time()),
                " s before it; times must strictly increase");
}

bool IsPossible(const v1::AgentState& state, const ScenarioLimits& limits) {
  return Within(state.time(), limits.max_time) & Within(state.x(), limits.max_coordinate) &
         Within(state.y(), limits.max_coordinate) & Within(state.heading(), limits.max_heading) &
         Within(state.velocity_x(), limits.max_speed) &
         Within(state.velocity_y(), limits.max_speed);
}

// Returns whether all states are possible, and each later than the one before it.
bool StatesAreGood(const v1::Agent& agent, const ScenarioLimits& limits) {
  bool good = true;
  double before = -HUGE_VAL;
  for (const v1::AgentState& state : agent.states()) {
    good = good & IsPossible(state, limits) & (state.time() > before);
    before = state.time();
  }
  return good;
}

// Adds what is wrong with a state.
void CheckState(const v1::Agent& agent, int agent_index, int index, const ScenarioLimits& limits,
                Violations* violations) {
  const v1::AgentState& state = agent.states(index);
  const std::string path = StrCat("agents[", agent_index, "].states[", index, "]");
  if (!TimeIsGood(agent.states(), index, limits)) {
    violations->Add(Member(path, "time"), BadTime(agent.states(), index, limits));
  }
  const auto check_coordinate = [&](const char* field, double value) {
    if (!Within(value, limits.max_coordinate)) {
      violations->Add(Member(path, field), OutOfCoordinates(value, limits.max_coordinate));
    }
  };
  const auto check_range = [&](const char* field, double value, double limit, const char* unit) {
    if (!Within(value, limit)) {
      violations->Add(Member(path, field), OutOfRange(value, -limit, limit, unit));
    }
  };
  check_coordinate("x", state.x());
  check_coordinate("y", state.y());
  check_range("heading", state.heading(), limits.max_heading, "rad");
  check_range("velocity_x", state.velocity_x(), limits.max_speed, "m/s");
  check_range("velocity_y", state.velocity_y(), limits.max_speed, "m/s");
}

void CheckAgent(const v1::Agent& agent, int index, const ScenarioLimits& limits,
                Violations* violations) {
  const bool good = v1::AgentType_IsValid(agent.type()) && agent.length() > 0.0 &&
                    agent.length() <= limits.max_size && agent.width() > 0.0 &&
                    agent.width() <= limits.max_size &&
                    agent.states_size() <= limits.max_states_per_agent;
  if (!good) {
    const std::string path = Element("agents", index);
    if (!v1::AgentType_IsValid(agent.type())) {
      violations->Add(Member(path, "type"),
                      StrCat(static_cast<int>(agent.type()), " is not a known agent type"));
    }
    CheckSize(path, "length", agent.length(), limits.max_size, violations);
    CheckSize(path, "width", agent.width(), limits.max_size, violations);
    if (!CheckCount(Member(path, "states"), agent.states_size(), limits.max_states_per_agent,
                    violations)) {
      return;
    }
  }
  if (StatesAreGood(agent, limits)) return;
  for (int i = 0; i < agent.states_size() && !violations->full(); ++i) {
    CheckState(agent, index, i, limits, violations);
  }
}

void CheckAgentIds(const v1::Scenario& scenario, Violations* violations) {
  std::vector<std::pair<int64_t, int>> ids(scenario.agents_size());
  for (int i = 0; i < scenario.agents_size(); ++i) ids[i] = {scenario.agents(i).id(), i};
  std::sort(ids.begin(), ids.end());
  for (size_t i = 1; i < ids.size() && !violations->full(); ++i) {
    if (ids[i].first != ids[i - 1].first) continue;
    violations->Add(Member(Element("agents", ids[i].second), "id"),
                    StrCat("is ", ids[i].first, ", which is also the id of agents[",
                           ids[i - 1].second, "]; ids must be unique"));
  }
}

// Checks a feature's coordinates along one axis.
void CheckCoordinates(int feature_index, const char* field,
                      const google::protobuf::RepeatedField<double>& values, double limit,
                      Violations* violations) {
  for (int i = 0; i < values.size() && !violations->full(); ++i) {
    if (Within(values[i], limit)) continue;
    violations->Add(StrCat("map_features[", feature_index, "].", field, "[", i, "]"),
                    OutOfCoordinates(values[i], limit));
  }
}

bool LinksAreGood(const v1::MapFeature& feature, const ScenarioLimits& limits) {
  return feature.successor_ids_size() <= limits.max_lane_links &&
         feature.left_neighbor_ids_size() <= limits.max_lane_links &&
         feature.right_neighbor_ids_size() <= limits.max_lane_links;
}

bool TypeIsGood(const v1::MapFeature& feature) {
  return v1::MapFeatureType_IsValid(feature.type()) &&
         feature.type() != v1::MAP_FEATURE_TYPE_UNSPECIFIED;
}

bool SpeedLimitIsGood(const v1::MapFeature& feature, const ScenarioLimits& limits) {
  return feature.speed_limit() >= 0.0 && feature.speed_limit() <= limits.max_speed;
}

// Returns whether all of a feature but its coordinates is good.
bool MembersAreGood(const v1::MapFeature& feature, const ScenarioLimits& limits) {
  return TypeIsGood(feature) && SpeedLimitIsGood(feature, limits) &&
         feature.x_size() == feature.y_size() && !feature.x().empty() &&
         LinksAreGood(feature, limits);
}

// Finds the boxes of all features. Returns whether all coordinates are within the limit.
bool CoordinatesAreGood(const MapFeatures& features, const ScenarioLimits& limits,
                        std::vector<Box>* boxes) {
  if (!FindBoxes(features, boxes)) return false;
  return std::ranges::all_of(*boxes, [&limits](const Box& box) {
    return box.low_x >= -limits.max_coordinate && box.low_y >= -limits.max_coordinate &&
           box.high_x <= limits.max_coordinate && box.high_y <= limits.max_coordinate;
  });
}

// Checks all of a feature but its coordinates.
void CheckMembers(const v1::MapFeature& feature, int index, const ScenarioLimits& limits,
                  Violations* violations) {
  if (MembersAreGood(feature, limits)) return;
  const std::string path = Element("map_features", index);
  if (!TypeIsGood(feature)) {
    violations->Add(Member(path, "type"), feature.type() == v1::MAP_FEATURE_TYPE_UNSPECIFIED
                                              ? std::string("is not stated")
                                              : StrCat(static_cast<int>(feature.type()),
                                                       " is not a known map feature type"));
  }
  if (feature.x_size() != feature.y_size()) {
    violations->Add(Member(path, "y"), StrCat("has ", feature.y_size(), " elements, but x has ",
                                              feature.x_size(), "; they must be as many"));
  } else if (feature.x().empty()) {
    violations->Add(Member(path, "x"), "has no points");
  }
  if (!SpeedLimitIsGood(feature, limits)) {
    violations->Add(Member(path, "speed_limit"),
                    OutOfRange(feature.speed_limit(), 0.0, limits.max_speed, "m/s"));
  }
  const auto check_links = [&](const char* field, int count) {
    CheckCount(Member(path, field), count, limits.max_lane_links, violations);
  };
  check_links("successor_ids", feature.successor_ids_size());
  check_links("left_neighbor_ids", feature.left_neighbor_ids_size());
  check_links("right_neighbor_ids", feature.right_neighbor_ids_size());
}

// `boxes`: gets the box of each feature of a map that is accepted.
void CheckMap(const MapFeatures& features, const ScenarioLimits& limits, Violations* violations,
              std::vector<Box>* boxes) {
  if (!CheckCount("map_features", features.size(), limits.max_map_features, violations)) return;
  int64_t points = 0;
  bool good = true;
  for (const v1::MapFeature& feature : features) {
    points += std::max(feature.x_size(), feature.y_size());
    good = good && MembersAreGood(feature, limits);
  }
  if (points > limits.max_map_points) {
    violations->Add("map_features", StrCat("have ", points, " points in all; at most ",
                                           limits.max_map_points, " are accepted"));
    return;
  }
  if (good && CoordinatesAreGood(features, limits, boxes)) return;
  for (int i = 0; i < features.size() && !violations->full(); ++i) {
    CheckMembers(features[i], i, limits, violations);
    CheckCoordinates(i, "x", features[i].x(), limits.max_coordinate, violations);
    CheckCoordinates(i, "y", features[i].y(), limits.max_coordinate, violations);
  }
}

void CheckMapId(const v1::Scenario& scenario, const ScenarioLimits& limits,
                Violations* violations) {
  if (scenario.map_id().empty()) return;
  if (!limits.map_by_id) {
    violations->Add("map_id", "is for requests of predictions; here the map has to be whole");
  } else if (!scenario.map_features().empty()) {
    violations->Add("map_id", "cannot be given together with map_features; name a map or send it");
  }
}

void CheckSignal(const v1::TrafficSignal& signal, int index, const ScenarioLimits& limits,
                 Violations* violations) {
  if (signal.readings_size() > limits.max_readings_per_signal) {
    CheckCount(Member(Element("traffic_signals", index), "readings"), signal.readings_size(),
               limits.max_readings_per_signal, violations);
    return;
  }
  for (int i = 0; i < signal.readings_size() && !violations->full(); ++i) {
    const v1::TrafficSignalReading& reading = signal.readings(i);
    const bool time_is_good = TimeIsGood(signal.readings(), i, limits);
    const bool state_is_good = v1::TrafficSignalState_IsValid(reading.state());
    if (time_is_good && state_is_good) continue;
    const std::string path = StrCat("traffic_signals[", index, "].readings[", i, "]");
    if (!time_is_good) {
      violations->Add(Member(path, "time"), BadTime(signal.readings(), i, limits));
    }
    if (!state_is_good) {
      violations->Add(Member(path, "state"), StrCat(static_cast<int>(reading.state()),
                                                    " is not a known traffic signal state"));
    }
  }
}

// Returns "; its nearest state is at 0.4 s", or says that there is none.
std::string NearestState(const v1::Agent& agent, double time) {
  const int past = FindState(agent, time, HUGE_VAL, time + kSameTime);
  if (past >= 0)
    return StrCat("; its nearest state is at ", Number(agent.states(past).time()), " s");
  if (agent.states().empty()) return "; it has no state at all";
  return StrCat("; its first state is later, at ", Number(agent.states(0).time()), " s");
}

}  // namespace

bool IsPhysicallyPossible(const v1::AgentState& state, const ScenarioLimits& limits) {
  return IsPossible(state, limits);
}

std::vector<FieldViolation> ValidateScenario(const v1::Scenario& scenario,
                                             const ScenarioLimits& limits,
                                             std::vector<Box>* boxes) {
  Violations violations(limits.max_violations);
  std::vector<Box> unwanted;
  if (!files::IsUtf8(scenario.scenario_id())) {
    violations.Add("scenario_id", "is not UTF-8");
  } else if (const int characters = Characters(scenario.scenario_id());
             characters > limits.max_scenario_id) {
    violations.Add("scenario_id", StrCat("has ", characters, " characters; at most ",
                                         limits.max_scenario_id, " are accepted"));
  }
  if (!Within(scenario.prediction_time(), limits.max_time)) {
    violations.Add("prediction_time",
                   OutOfRange(scenario.prediction_time(), -limits.max_time, limits.max_time, "s"));
  }
  CheckCount("target_ids", scenario.target_ids_size(), limits.max_targets, &violations);
  if (CheckCount("agents", scenario.agents_size(), limits.max_agents, &violations)) {
    for (int i = 0; i < scenario.agents_size() && !violations.full(); ++i) {
      CheckAgent(scenario.agents(i), i, limits, &violations);
    }
    CheckAgentIds(scenario, &violations);
  }
  CheckMap(scenario.map_features(), limits, &violations, boxes == nullptr ? &unwanted : boxes);
  CheckMapId(scenario, limits, &violations);
  if (CheckCount("traffic_signals", scenario.traffic_signals_size(), limits.max_traffic_signals,
                 &violations)) {
    for (int i = 0; i < scenario.traffic_signals_size() && !violations.full(); ++i) {
      CheckSignal(scenario.traffic_signals(i), i, limits, &violations);
    }
  }
  return violations.Take();
}

std::vector<FieldViolation> ValidateMap(const MapFeatures& features, const ScenarioLimits& limits) {
  Violations violations(limits.max_violations);
  std::vector<Box> boxes;
  CheckMap(features, limits, &violations, &boxes);
  return violations.Take();
}

std::optional<FieldViolation> ValidateTarget(const v1::Scenario& scenario, int target_index,
                                             double tolerance) {
  const auto& ids = scenario.target_ids();
  const int64_t id = ids[target_index];
  const auto violation = [&](std::string description) {
    return FieldViolation{Element("target_ids", target_index), std::move(description)};
  };
  const auto first = std::find(ids.begin(), ids.begin() + target_index, id);
  if (first != ids.begin() + target_index) {
    return violation(
        StrCat("is ", id, ", as is target_ids[", first - ids.begin(), "]; name each target once"));
  }
  const v1::Agent* agent = FindAgent(scenario, id);
  if (agent == nullptr) return violation(StrCat("no agent has the id ", id));
  const double time = scenario.prediction_time();
  if (TargetPose(*agent, time, tolerance).has_value()) return std::nullopt;
  return violation(StrCat("agent ", id, " has no state within ", Number(tolerance),
                          " s before the prediction time, ", Number(time), " s",
                          NearestState(*agent, time)));
}

}  // namespace maneuver::scene
