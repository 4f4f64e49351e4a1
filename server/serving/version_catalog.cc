// The part of ModelRegistry that shows what is there.

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_cost.h"
#include "model/artifact/model_folder.h"
#include "model/evaluation/action_names.h"
#include "server/errors/error_details.h"
#include "server/serving/model_registry.h"

namespace maneuver::serving {

using security::ModelVersionName;

std::vector<ModelRegistry::VersionInfo> ModelRegistry::List(const std::string& model) const {
  std::vector<VersionInfo> found;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, versions] : versions_) {
      if (!model.empty() && id != model) continue;
      for (const int version : versions) {
        const ModelVersionName name{id, version};
        found.push_back({name, {}, AliasesOfLocked(name)});
      }
    }
  }
  for (VersionInfo& info : found) info.create_time = folders_.CreateTime(info.name);
  std::ranges::sort(found, [](const VersionInfo& a, const VersionInfo& b) {
    if (a.create_time != b.create_time) return a.create_time > b.create_time;
    if (a.name.model != b.name.model) return a.name.model < b.name.model;
    return a.name.version > b.name.version;
  });
  return found;
}

absl::StatusOr<v1::ModelVersion> ModelRegistry::Describe(const ModelVersionName& name) const {
  v1::ModelVersion version;
  version.set_name(name.ToString());
  {
    const std::lock_guard lock(mutex_);
    if (const auto resolved = ResolveLocked(name); !resolved.ok()) return resolved.status();
    for (const std::string& alias : AliasesOfLocked(name)) version.add_aliases(alias);
  }
  auto manifest = artifact::ReadModelManifest(folders_.FolderOf(name));
  if (!manifest.ok()) {
    return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                  name.ToString(), " is damaged: ", manifest.status().message())),
                              "MODEL_DAMAGED", {{"model_version", name.ToString()}});
  }
  *version.mutable_cost() = artifact::CountCost(manifest->spec());
  evaluation::CompleteActionNames(*manifest);
  *version.mutable_manifest() = *std::move(manifest);
  const auto since_epoch = std::chrono::duration_cast<std::chrono::nanoseconds>(
                               folders_.CreateTime(name).time_since_epoch())
                               .count();
  constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;
  version.mutable_create_time()->set_seconds(since_epoch / kNanosecondsPerSecond);
  version.mutable_create_time()->set_nanos(
      static_cast<int32_t>(since_epoch % kNanosecondsPerSecond));
  return version;
}

absl::StatusOr<v1::Action> ModelRegistry::LabelAction(const ModelVersionName& name, int action_id,
                                                      const std::string& label) {
  const std::lock_guard change(change_mutex_);
  auto version = Describe(name);
  if (!version.ok()) return version.status();
  v1::ModelManifest& manifest = *version->mutable_manifest();
  const auto action = std::ranges::find(*manifest.mutable_actions(), action_id,
                                        [](const v1::Action& a) { return a.action_id(); });
  if (action == manifest.mutable_actions()->end()) {
    return absl::OutOfRangeError(
        absl::StrCat(name.ToString(), " has the actions 0 to ", manifest.actions_size() - 1));
  }
  action->set_label(label);
  evaluation::CompleteActionNames(manifest);
  v1::Action labelled = *action;
  if (auto status = artifact::RewriteModelManifest(folders_.FolderOf(name), manifest);
      !status.ok()) {
    return status;
  }
  const std::lock_guard lock(mutex_);
  if (const auto resident = resident_.find(name); resident != resident_.end()) {
    resident->second.handle->SetActionNames(evaluation::DisplayNames(manifest));
  }
  return labelled;
}

}  // namespace maneuver::serving
