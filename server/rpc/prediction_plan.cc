#include "server/rpc/prediction_plan.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/data/trajectory.h"
#include "model/inference/joint_combinations.h"
#include "model/scene/observation_window.h"
#include "model/scene/scene_warnings.h"
#include "model/scene/target_frame.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {
namespace {

// Returns what the target did after the prediction time, resampled to the model's waypoints:
// [T, 2] target frame, metres.
absl::StatusOr<inference::Trajectory> ObservedTrajectory(const v1::Scenario& scenario,
                                                         const v1::Agent& agent, int agent_index,
                                                         const scene::Pose2& X_WT,
                                                         const v1::ModelSpec& spec,
                                                         const std::string& scenario_path) {
  const std::vector<double> times = artifact::WaypointTimes(spec.trajectory());
  inference::Trajectory trajectory(static_cast<Eigen::Index>(times.size()), 2);
  int missing = 0;
  if (!data::ResampleFuture(
          agent, scenario.prediction_time(), X_WT, times, scene::WindowOf(spec).max_gap(),
          {trajectory.data(), static_cast<size_t>(trajectory.size())}, &missing)) {
    return errors::InvalidField(
        absl::StrCat(scenario_path, ".agents[", agent_index, "].states"),
        absl::StrCat("no states around ", times[static_cast<size_t>(missing)],
                     " s after the prediction time; classification needs the ", times.back(),
                     " s that the model looks ahead, without gaps"));
  }
  return trajectory;
}

absl::Status TypeNotLearned(const std::string& field, const v1::Agent& agent,
                            const v1::ModelSpec& spec) {
  return errors::WithReason(
      errors::InvalidField(field, absl::StrCat("is ", artifact::AgentText(agent.type()),
                                               ", and the model has learned to predict ",
                                               artifact::TargetTypesText(spec), " alone")),
      "TARGET_TYPE_NOT_LEARNED", {{"predicts", artifact::TargetTypesText(spec)}});
}

}  // namespace

int CountTargets(const Scenarios& scenarios) {
  int targets = 0;
  for (const v1::Scenario& scenario : scenarios) targets += scenario.target_ids_size();
  return targets;
}

absl::StatusOr<ScenarioMaps> FindMaps(const Scenarios& scenarios, serving::MapCache& maps) {
  ScenarioMaps found;
  for (int s = 0; s < scenarios.size(); ++s) {
    const std::string& id = scenarios[s].map_id();
    if (!serving::IsMapId(id)) continue;
    found.resize(static_cast<size_t>(scenarios.size()));
    auto& map = found[static_cast<size_t>(s)];
    map = maps.Find(id);
    if (map == nullptr) {
      return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                    "scenarios[", s,
                                    "].map_id: the server does not hold this map; register it with "
                                    "RegisterMap and repeat the request")),
                                "MAP_NOT_REGISTERED", {{"map_id", id}});
    }
  }
  return found;
}

PredictionPlan PlanPrediction(const Scenarios& scenarios, const v1::ModelSpec& spec,
                              const scene::ScenarioLimits& limits, bool classify, ScenarioMaps maps,
                              bool strict, std::span<const std::string> paths, bool joint) {
  PredictionPlan plan{.scenarios = {}, .targets = {}, .maps = std::move(maps)};
  plan.maps.resize(static_cast<size_t>(scenarios.size()));
  const double tolerance = scene::WindowOf(spec).tolerance();
  for (int s = 0; s < scenarios.size(); ++s) {
    const v1::Scenario& scenario = scenarios[s];
    const std::string path =
        paths.empty() ? absl::StrCat("scenarios[", s, "]") : paths[static_cast<size_t>(s)];
    PlannedScenario& planned = plan.scenarios.emplace_back();

    std::vector<scene::Box> boxes;
    auto violations = scene::ValidateScenario(scenario, limits, &boxes);
    if (!scenario.map_id().empty() && !serving::IsMapId(scenario.map_id())) {
      violations.push_back({"map_id", "is not what RegisterMap gives: 64 lower-case hex digits"});
    }
    if (scenario.target_ids().empty()) {
      violations.push_back({"target_ids", "name at least one agent to predict"});
    }
    if (joint && scenario.target_ids_size() > static_cast<int>(inference::kMostJointTargets)) {
      violations.push_back({"target_ids", absl::StrCat("query.joint_combinations combines at most ",
                                                       inference::kMostJointTargets,
                                                       " targets; name those that "
                                                       "interact, or ask for several scenarios")});
    }
    if (!violations.empty()) {
      // ValidateScenario stops at as many, so how many others there are is not known.
      violations.resize(std::min(violations.size(), errors::kMaxListedViolations));
      planned.status = errors::InvalidFields(violations, path);
      continue;
    }
    auto& map = plan.maps[static_cast<size_t>(s)];
    if (map == nullptr) {
      map = std::make_shared<scene::RoadMap>(
          scene::RoadMap::Over(scenario.map_features(), std::move(boxes)));
    }
    planned.warnings = scene::FindSceneWarnings(scenario, *map, tolerance);
    if (strict && !planned.warnings.empty()) {
      planned.status = errors::InvalidFields(planned.warnings, path);
      continue;
    }
    for (int t = 0; t < scenario.target_ids_size(); ++t) {
      PlannedTarget& target = planned.targets.emplace_back();
      target.id = scenario.target_ids(t);
      if (const auto violation = scene::ValidateTarget(scenario, t, tolerance)) {
        target.status = errors::InvalidFields({*violation}, path);
        continue;
      }
      const v1::Agent* agent = scene::FindAgent(scenario, target.id);
      if (!artifact::Predicts(spec, agent->type())) {
        target.status = TypeNotLearned(absl::StrCat(path, ".target_ids[", t, "]"), *agent, spec);
        continue;
      }
      const auto X_WT =
          scene::TargetPose(*agent, scenario.prediction_time(), tolerance, spec.inputs_version());
      if (!X_WT) {
        target.status = errors::InvalidField(absl::StrCat(path, ".target_ids[", t, "]"),
                                             "has no state at the prediction time");
        continue;
      }
      serving::Target work{.scenario = &scenario, .id = target.id, .X_WT = *X_WT, .map = map.get()};
      if (classify) {
        int agent_index = 0;
        while (&scenario.agents(agent_index) != agent) ++agent_index;
        auto trajectory = ObservedTrajectory(scenario, *agent, agent_index, *X_WT, spec, path);
        if (!trajectory.ok()) {
          target.status = trajectory.status();
          continue;
        }
        work.trajectory = *std::move(trajectory);
      }
      target.index = plan.targets.size();
      plan.targets.push_back(std::move(work));
    }
  }
  return plan;
}

}  // namespace maneuver::rpc
