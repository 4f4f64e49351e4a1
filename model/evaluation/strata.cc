#include "model/evaluation/strata.h"

#include <algorithm>
#include <cmath>

#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

constexpr std::array<std::string_view, 4> kAgents = {"<=10", "11-30", "31-60", ">60"};
constexpr std::array<std::string_view, 5> kSpeeds = {"standing", "0.5-5 m/s", "5-10 m/s",
                                                     "10-15 m/s", ">=15 m/s"};
constexpr std::array<std::string_view, 3> kTurns = {"straight", "left", "right"};
constexpr std::array<std::string_view, 4> kTypes = {"vehicle", "pedestrian", "cyclist", "other"};

// Returns how many of `limits` (increasing) `value` reaches.
template <typename T, size_t n>
int Reached(const std::array<T, n>& limits, T value) {
  return static_cast<int>(std::upper_bound(limits.begin(), limits.end(), value) - limits.begin());
}

int AgentStratum(const StratumKeys& keys) { return Reached(std::array{11, 31, 61}, keys.agents); }

int SpeedStratum(const StratumKeys& keys) {
  return Reached(std::array{0.5, 5.0, 10.0, 15.0}, keys.speed);
}

int TurnStratum(const StratumKeys& keys) {
  if (std::abs(keys.heading_change) < kTurnHeadingChange) return 0;
  return keys.heading_change > 0.0 ? 1 : 2;
}

int ClassStratum(const StratumKeys& keys) { return static_cast<int>(keys.kinematic_class); }

int TypeStratum(const StratumKeys& keys) {
  switch (keys.type) {
    case v1::AGENT_TYPE_VEHICLE:
      return 0;
    case v1::AGENT_TYPE_PEDESTRIAN:
      return 1;
    case v1::AGENT_TYPE_CYCLIST:
      return 2;
    default:
      return 3;
  }
}

}  // namespace

const std::array<Stratification, 5>& Stratifications() {
  static constexpr std::array<Stratification, 5> kStratifications = {
      {{"agents", kAgents, AgentStratum},
       {"speed", kSpeeds, SpeedStratum},
       {"turn", kTurns, TurnStratum},
       {"class", kKinematicClassNames, ClassStratum},
       {"type", kTypes, TypeStratum}}};
  return kStratifications;
}

int AgentsAt(const v1::Scenario& recording, double time, double tolerance) {
  return static_cast<int>(std::count_if(
      recording.agents().begin(), recording.agents().end(), [&](const v1::Agent& agent) {
        return scene::FindState(agent, time, tolerance, time + scene::kSameTime) >= 0;
      }));
}

}  // namespace maneuver::evaluation
