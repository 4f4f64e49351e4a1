// The part of ModelRegistry that takes in new versions.

#include <chrono>
#include <utility>

#include "server/monitoring/logging.h"
#include "server/serving/model_registry.h"

namespace maneuver::serving {

using monitoring::Log;
using monitoring::LogLevel;
using security::kServingAlias;
using security::ModelAliasName;
using security::ModelVersionName;

bool ModelRegistry::WantsPromotionLocked(const std::string& model, v1::Promotion promotion) const {
  if (promotion == v1::PROMOTION_ALWAYS) return true;
  return promotion == v1::PROMOTION_UNSPECIFIED &&
         !aliases_.contains({model, std::string(kServingAlias)});
}

absl::StatusOr<ModelVersionName> ModelRegistry::Publish(const std::string& model,
                                                        const std::filesystem::path& finished,
                                                        v1::Promotion promotion,
                                                        const std::string& maker) {
  if (!security::IsResourceId(model)) {
    return absl::InvalidArgumentError("a model's name is [a-z][a-z0-9-]*, at most 63 characters");
  }
  const std::lock_guard change(change_mutex_);
  const ModelAliasName serving{model, std::string(kServingAlias)};
  std::set<int> versions;
  bool promote = false;
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = versions_.find(model); found != versions_.end()) {
      versions = found->second;
    }
    promote = WantsPromotionLocked(model, promotion);
  }
  const auto number = folders_.NextVersion(model, versions);
  if (!number.ok()) return number.status();
  const ModelVersionName name{model, *number};
  const auto handle = LoadFolder(name, finished);
  if (!handle.ok()) return handle.status();
  if (auto status = folders_.Add(name, finished, maker, std::chrono::system_clock::now());
      !status.ok()) {
    return status;
  }
  if (promote) {
    if (auto status = PointAlias(serving, *handle); !status.ok()) {
      const absl::Status undone = folders_.TakeBack(name, finished);
      if (!undone.ok())
        Log(LogLevel::kError, "half-registered model", {{"model_version", name.ToString()}});
      return status;
    }
  } else {
    const std::lock_guard lock(mutex_);
    versions_[model].insert(name.version);
  }
  Log(LogLevel::kInfo, "model registered", {{"model_version", name.ToString()}});
  return name;
}

absl::StatusOr<std::optional<ModelVersionName>> ModelRegistry::FindMadeBy(
    const std::string& model, v1::Promotion promotion, const std::string& maker) {
  const std::lock_guard change(change_mutex_);
  const ModelAliasName serving{model, std::string(kServingAlias)};
  std::optional<ModelVersionName> found;
  bool promote = false;
  {
    const std::lock_guard lock(mutex_);
    if (const auto versions = versions_.find(model); versions != versions_.end()) {
      for (const int version : versions->second) {
        if (folders_.Maker({model, version}) == maker) found = {model, version};
      }
    }
    if (!found) return found;
    const auto alias = aliases_.find(serving);
    promote = WantsPromotionLocked(model, promotion) &&
              (alias == aliases_.end() || alias->second != found->version);
  }
  if (promote) {
    const auto handle = LoadVersion(*found);
    if (!handle.ok()) return handle.status();
    if (auto status = PointAlias(serving, *handle); !status.ok()) return status;
  }
  return found;
}

std::optional<ModelVersionName> ModelRegistry::Serving(const std::string& model) const {
  const std::lock_guard lock(mutex_);
  const auto alias = aliases_.find({model, std::string(kServingAlias)});
  if (alias == aliases_.end()) return std::nullopt;
  return ModelVersionName{model, alias->second};
}

absl::StatusOr<bool> ModelRegistry::PromoteOver(const ModelVersionName& name,
                                                const std::optional<ModelVersionName>& before) {
  const std::lock_guard change(change_mutex_);
  if (Serving(name.model) != before) return false;
  const auto handle = LoadVersion(name);
  if (!handle.ok()) return handle.status();
  const absl::Status status = PointAlias({name.model, std::string(kServingAlias)}, *handle);
  if (!status.ok()) return status;
  return true;
}

}  // namespace maneuver::serving
