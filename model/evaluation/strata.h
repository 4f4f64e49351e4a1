// Divides the examples into parts that are also measured separately.

#ifndef MANEUVER_MODEL_EVALUATION_STRATA_H_
#define MANEUVER_MODEL_EVALUATION_STRATA_H_

#include <array>
#include <span>
#include <string_view>

#include "maneuver/v1/scenario.pb.h"
#include "model/evaluation/kinematic_classes.h"

namespace maneuver::evaluation {

// The properties of an example that decide its strata, and whether it is like others.
struct StratumKeys {
  int agents = 0;               // present at the prediction time, target included
  double speed = 0.0;           // of the target at the prediction time, m/s
  double heading_change = 0.0;  // of the target at the horizon, radians, counter-clockwise
  KinematicClass kinematic_class = KinematicClass::kStationary;  // of its trajectory
  v1::AgentType type = v1::AGENT_TYPE_VEHICLE;                   // of the target
  int map_features = 0;  // near the target (MapFeaturesNear)
};

// One way to divide the examples.
struct Stratification {
  std::string_view dimension;               // "agents", "speed", "turn", "class", "type"
  std::span<const std::string_view> names;  // of its strata
  int (*stratum)(const StratumKeys& keys);  // index into names
};

// Returns five ways to divide the examples:
//   agents   <=10, 11-30, 31-60, >60
//   speed    standing below 0.5 m/s, then up to 5, 10 and 15, and above
//   turn     left or right from a heading change of 30 degrees, otherwise straight
//   class    each KinematicClass
//   type     vehicle, pedestrian, cyclist or other
const std::array<Stratification, 5>& Stratifications();

// Returns the number of agents of any type that have a state at `time` or at most `tolerance` seconds
// before it. Ignores later states.
int AgentsAt(const v1::Scenario& recording, double time, double tolerance);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_STRATA_H_
