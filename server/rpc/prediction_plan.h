// The plan of a prediction request: which of its targets can be answered, and what each needs.

#ifndef MANEUVER_SERVER_RPC_PREDICTION_PLAN_H_
#define MANEUVER_SERVER_RPC_PREDICTION_PLAN_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "model/scene/field_violation.h"
#include "model/scene/road_map.h"
#include "model/scene/scenario_validation.h"
#include "server/serving/map_cache.h"
#include "server/serving/prediction_call.h"

namespace maneuver::rpc {

// No scenario_id of a valid scene is longer: a character takes at most four bytes. Answers name only
// such ids.
inline constexpr size_t kMostScenarioIdBytes =
    4 * static_cast<size_t>(scene::ScenarioLimits().max_scenario_id);

using Scenarios = google::protobuf::RepeatedPtrField<v1::Scenario>;

// Returns how many targets the scenarios name.
int CountTargets(const Scenarios& scenarios);

// One target id of the request: an error, or its place in PredictionPlan::targets.
struct PlannedTarget {
  int64_t id = 0;
  absl::Status status;
  size_t index = 0;  // if the status is OK
};
struct PlannedScenario {
  absl::Status status;  // if not OK there are no targets
  std::vector<PlannedTarget> targets;
  // Fields that look wrong although they are valid. Paths start at the scenario.
  std::vector<scene::FieldViolation> warnings;
};
// The map of each scenario. As FindMaps returns it: the registered map that the scenario names, or
// nullptr; empty if no scenario names one. In a plan: the same, but the scenario's own map in place
// of nullptr.
using ScenarioMaps = std::vector<std::shared_ptr<const scene::RoadMap>>;

struct PredictionPlan {
  std::vector<PlannedScenario> scenarios;
  std::vector<serving::Target> targets;
  ScenarioMaps maps;  // that the targets point to
};

// Looks up the maps that scenarios name. FAILED_PRECONDITION with the reason MAP_NOT_REGISTERED if
// the server does not hold one. Ignores malformed map ids, which PlanPrediction reports.
absl::StatusOr<ScenarioMaps> FindMaps(const Scenarios& scenarios, serving::MapCache& maps);

// Validates each scenario and target for a model. An invalid scenario or target gets
// INVALID_ARGUMENT with the field; the others are answered. The plan points to `scenarios`.
//   classify: each target also needs its future, resampled to the model's waypoints.
//   maps: from FindMaps.
//   strict: refuse a scenario that has warnings.
//   paths: where each scenario is in the request; empty: scenarios[0] and so on.
//   joint: the actions of a scenario's targets are combined: refuse more targets than that can.
PredictionPlan PlanPrediction(const Scenarios& scenarios, const v1::ModelSpec& spec,
                              const scene::ScenarioLimits& limits, bool classify,
                              ScenarioMaps maps = {}, bool strict = false,
                              std::span<const std::string> paths = {}, bool joint = false);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_PLAN_H_
