#include "client/cli/load_scenes.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/scenario_files.h"
#include "client/cli/scenario_source.h"
#include "client/cli/target_selection.h"
#include "model/data/town/synthetic_town.h"

namespace maneuver::cli {
namespace {

// The targets that the recording names, or more moving vehicles where more are wanted.
void ChooseTargets(int most, v1::Scenario* scene) {
  const double now = scene->prediction_time();
  std::vector<int64_t> targets = DefaultTargets(*scene, v1::AGENT_TYPE_VEHICLE, now);
  if (static_cast<int>(targets.size()) < most) {
    std::vector<int64_t> moving = MovingAgents(*scene, v1::AGENT_TYPE_VEHICLE, now, most);
    if (moving.size() > targets.size()) targets = std::move(moving);
  }
  scene->mutable_target_ids()->Assign(targets.begin(), targets.end());
}

absl::StatusOr<std::vector<v1::Scenario>> FromDataset(const LoadScenes& wanted,
                                                      Environment& environment) {
  std::vector<v1::Scenario> scenes;
  const absl::Status status =
      VisitScenarios(wanted.source, wanted.most, environment, [&](v1::Scenario&& scene) {
        ChooseTargets(wanted.most_targets, &scene);
        if (!scene.target_ids().empty()) scenes.push_back(std::move(scene));
      });
  if (!status.ok()) return status;
  if (scenes.empty()) {
    return absl::NotFoundError(
        absl::StrCat("no scene of ", wanted.source, " has a vehicle to ask about"));
  }
  return scenes;
}

}  // namespace

absl::StatusOr<std::vector<v1::Scenario>> ReadLoadScenes(const LoadScenes& wanted,
                                                         Environment& environment) {
  if (!wanted.files.empty()) return ReadScenarios(wanted.files, environment);
  if (!wanted.source.empty()) return FromDataset(wanted, environment);
  std::vector<v1::Scenario> scenes;
  for (int i = 0; i < wanted.most; ++i) {
    v1::Scenario scene = data::town::GenerateRecording({.seed = wanted.seed}, i).scenario;
    ChooseTargets(wanted.most_targets, &scene);
    if (!scene.target_ids().empty()) scenes.push_back(std::move(scene));
  }
  if (scenes.empty())
    return absl::NotFoundError("no scene of this town has a vehicle to ask about");
  return scenes;
}

}  // namespace maneuver::cli
