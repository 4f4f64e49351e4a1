// Between the messages of PredictionService and the scheduler's plain types: what a request asks,
// which of its targets can be answered, and the answers in the caller's frame. Knows nothing of
// gRPC.

#ifndef MANEUVER_SERVER_RPC_PREDICTION_TRANSLATION_H_
#define MANEUVER_SERVER_RPC_PREDICTION_TRANSLATION_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "model/scene/scenario_validation.h"
#include "server/security/resource_name.h"
#include "server/serving/map_cache.h"
#include "server/serving/prediction_call.h"

namespace maneuver::rpc {

using Scenarios = google::protobuf::RepeatedPtrField<v1::Scenario>;

// The actions that a query asks for, of a model with `actions` of them. Violations are named from
// the query: action_ids.ids[0], top_k, ...
absl::StatusOr<serving::DescribeActions> ParseQuery(const v1::DistributionQuery& query,
                                                    int actions);

absl::StatusOr<serving::Priority> ParsePriority(v1::Priority priority);

// What becomes of one target id of the request: an error, or its place in `targets`.
struct PlannedTarget {
  int64_t id = 0;
  absl::Status status;
  size_t index = 0;  // into PredictionPlan::targets, if OK
};
struct PlannedScenario {
  absl::Status status;  // if not OK there are no targets
  std::vector<PlannedTarget> targets;
};
// Of each scenario the map that it names, or nullptr; empty if no scenario names one. Of a plan:
// the one that it names, or its own.
using ScenarioMaps = std::vector<std::shared_ptr<const scene::RoadMap>>;

struct PredictionPlan {
  std::vector<PlannedScenario> scenarios;
  std::vector<serving::Target> targets;
  ScenarioMaps maps;  // which the targets point to
};

// Looks up the maps that scenarios name. FAILED_PRECONDITION with the reason MAP_NOT_REGISTERED if
// one is not held; ids that could be none are left to PlanPrediction.
absl::StatusOr<ScenarioMaps> FindMaps(const Scenarios& scenarios, serving::MapCache& maps);

// Validates each scenario and target for a model. Those that are bad fail alone.
//   classify: whether each target's future is needed as well, resampled to the model's waypoints.
//   maps: by FindMaps.
PredictionPlan PlanPrediction(const Scenarios& scenarios, const v1::ModelSpec& spec,
                              const scene::ScenarioLimits& limits, bool classify,
                              ScenarioMaps maps = {});

// What an answer leaves out, and its frame.
struct AnswerStyle {
  bool probabilities = true;
  bool sigma_trajectories = true;
  v1::Frame frame = v1::FRAME_WORLD;
};

void WritePredictions(const Scenarios& scenarios, const PredictionPlan& plan,
                      const std::vector<serving::TargetAnswer>& answers, const AnswerStyle& style,
                      google::protobuf::RepeatedPtrField<v1::ScenarioPrediction>* predictions);

void WriteClassifications(
    const Scenarios& scenarios, const PredictionPlan& plan,
    const std::vector<serving::TargetAnswer>& answers,
    google::protobuf::RepeatedPtrField<v1::ScenarioClassification>* classifications);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_TRANSLATION_H_
