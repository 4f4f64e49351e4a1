#include "server/serving/serving_table.h"

#include <algorithm>
#include <chrono>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "model/artifact/model_folder.h"
#include "model/evaluation/action_names.h"
#include "model/files/file_system_failure.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"

namespace maneuver::serving {
namespace {

using monitoring::Log;
using monitoring::LogLevel;
using security::kServingAlias;
using security::ModelAliasName;
using security::ModelVersionName;

absl::Status Unusable(const ModelVersionName& name, const absl::Status& why) {
  if (files::IsFileSystemFailure(why)) return errors::WithFolderReason(why, "models");
  return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                name.ToString(), " cannot be served: ", why.message(),
                                "; point the alias to another version, or train a new one")),
                            "MODEL_DAMAGED", {{"model_version", name.ToString()}});
}

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServingTable>> ServingTable::Open(
    VersionStore& versions, AliasStore& aliases, ModelLoader loader,
    const ServingTableOptions& options, monitoring::MetricRegistry& metrics) {
  std::unique_ptr<ServingTable> table(
      new ServingTable(versions, aliases, std::move(loader), options, metrics));
  auto stored = aliases.ListAliases();
  if (!stored.ok()) return stored.status();
  const MutexLock lock(table->mutex_);
  for (const ModelAlias& alias : *stored) table->aliases_[alias.name] = alias.version;
  return table;
}

ServingTable::ServingTable(VersionStore& versions, AliasStore& aliases, ModelLoader loader,
                           const ServingTableOptions& options, monitoring::MetricRegistry& metrics)
    : versions_(versions),
      alias_store_(aliases),
      loader_(std::move(loader)),
      options_(options),
      metrics_(metrics, options.serves) {}

void ServingTable::OnReadyChange(std::function<void(bool)> listener) {
  const MutexLock change(change_mutex_);
  listener_ = std::move(listener);
  NotifyReady();
}

bool ServingTable::Ready() const {
  const MutexLock lock(mutex_);
  const auto is_loaded = [this](const auto& entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return entry.first.alias == kServingAlias &&
           resident_.contains({entry.first.model, entry.second});
  };
  return std::ranges::any_of(aliases_, is_loaded);
}

void ServingTable::NotifyReady() {
  std::map<ModelAliasName, int> loaded;
  for (const ModelAlias& alias : Loaded()) loaded[alias.name] = alias.version;
  metrics_.Show(loaded);
  if (listener_) listener_(Ready());
}

std::vector<ModelAlias> ServingTable::Loaded() const {
  std::vector<ModelAlias> loaded;
  const MutexLock lock(mutex_);
  for (const auto& [name, version] : aliases_) {
    if (resident_.contains({name.model, version})) loaded.push_back({name, version});
  }
  return loaded;
}

void ServingTable::LoadAliased() {
  if (!options_.serves) return;
  std::set<ModelVersionName> wanted;
  {
    const MutexLock lock(mutex_);
    for (const auto& [name, version] : aliases_) {
      const ModelVersionName aliased{name.model, version};
      if (LateLoadErrorLocked(aliased).ok()) wanted.insert(aliased);
    }
  }
  for (const ModelVersionName& name : wanted) {
    const MutexLock change(change_mutex_);
    // Failures are logged there, and kept for those who ask.
    (void)LoadVersion(name);
    NotifyReady();
  }
}

void ServingTable::Follow() {
  const MutexLock change(change_mutex_);
  absl::Status status = FollowStores();
  if (!status.ok() && !errors::IsStoreAway(status) && status != last_failure_) {
    Log(LogLevel::kError, "cannot follow the other servers",
        {{"reason", std::string(status.message())}});
  }
  last_failure_ = std::move(status);
}

absl::Status ServingTable::FollowStores() {
  // In this order: every version that an alias points to is known then.
  const auto stored = alias_store_.ListAliases();
  if (!stored.ok()) return stored.status();
  if (absl::Status status = versions_.Refresh(); !status.ok()) return status;
  bool changed = false;
  std::set<ModelAliasName> present;
  for (const ModelAlias& alias : *stored) {
    present.insert(alias.name);
    changed = FollowAlias(alias.name, alias.version) || changed;
  }
  {
    const MutexLock lock(mutex_);
    changed =
        std::erase_if(aliases_, [&](const auto& alias) { return !present.contains(alias.first); }) >
            0 ||
        changed;
  }
  FollowLabels();
  if (changed) NotifyReady();
  return absl::OkStatus();
}

bool ServingTable::FollowAlias(const ModelAliasName& name, int version) {
  const ModelVersionName wanted{name.model, version};
  {
    const MutexLock lock(mutex_);
    const auto found = aliases_.find(name);
    const bool is_there = found != aliases_.end() && found->second == version;
    if (is_there && (resident_.contains(wanted) || !options_.serves)) return false;
    if (!options_.serves) {
      aliases_[name] = version;
      return true;
    }
    if (!LateLoadErrorLocked(wanted).ok()) return false;
  }
  const auto handle = LoadVersion(wanted);
  if (!handle.ok()) return false;
  Swap(name, *handle);
  return true;
}

void ServingTable::FollowLabels() {
  std::map<ModelVersionName, int64_t> changed;
  {
    const MutexLock lock(mutex_);
    for (const auto& [name, resident] : resident_) {
      const int64_t revision = versions_.Revision(name);
      if (resident.revision != revision) changed[name] = revision;
    }
  }
  for (const auto& [name, revision] : changed) {
    const auto version = versions_.Describe(name);
    if (!version.ok()) continue;  // tried again by the next call
    const MutexLock lock(mutex_);
    Resident& resident = resident_.at(name);
    resident.handle->SetActionNames(evaluation::DisplayNames(version->manifest()));
    resident.revision = revision;
  }
}

absl::Status ServingTable::NoAliasLocked(const ModelAliasName& name,
                                         absl::string_view advice) const {
  const std::string model = absl::StrCat("models/", name.model);
  if (!versions_.ContainsModel(name.model)) {
    return errors::WithReason(
        absl::NotFoundError(
            absl::StrCat("there is no ", model, "; ListModelVersions names those that exist")),
        "MODEL_NOT_FOUND", {{"model", model}});
  }
  std::vector<std::string> others;  // sorted, as the map is
  for (const auto& [alias, version] : aliases_) {
    if (alias.model == name.model) others.push_back(alias.alias);
  }
  return errors::WithReason(
      absl::NotFoundError(absl::StrCat(
          "there is no ", name.ToString(), "; ", model,
          others.empty() ? " has no alias" : " has " + absl::StrJoin(others, ", "), advice)),
      "MODEL_ALIAS_NOT_FOUND", {{"alias", name.ToString()}});
}

absl::Status ServingTable::NotNamedLocked() const {
  constexpr size_t kMostNamed = 10;
  std::vector<std::string> serving;
  for (const auto& [alias, version] : aliases_) {
    if (alias.alias == kServingAlias) serving.push_back(absl::StrCat("models/", alias.model));
  }
  if (serving.size() > kMostNamed) {
    serving.resize(kMostNamed);
    serving.push_back("...");
  }
  return errors::WithReason(
      absl::FailedPreconditionError(absl::StrCat(
          "several models serve: ", absl::StrJoin(serving, ", "), "; name one of them in `model`")),
      "MODEL_NOT_NAMED");
}

absl::StatusOr<ModelVersionName> ServingTable::ResolveLocked(
    const std::optional<security::ModelReference>& reference) const {
  ModelVersionName name;
  if (!reference) {
    for (const auto& [alias, version] : aliases_) {
      if (alias.alias != kServingAlias) continue;
      if (name.version != 0) return NotNamedLocked();
      name = {alias.model, version};
    }
    if (name.version == 0) {
      return errors::WithReason(
          absl::FailedPreconditionError("no model serves yet; train one, or point the alias "
                                        "`serving` of a model to one of its versions"),
          "NO_MODEL_SERVES");
    }
  } else if (const auto* alias = std::get_if<ModelAliasName>(&*reference)) {
    const auto found = aliases_.find(*alias);
    if (found == aliases_.end()) {
      return NoAliasLocked(*alias, "; point it to a version with SetModelAlias");
    }
    name = {alias->model, found->second};
  } else {
    name = std::get<ModelVersionName>(*reference);
  }
  if (absl::Status status = versions_.CheckExists(name); !status.ok()) return status;
  return name;
}

absl::StatusOr<ModelHandle> ServingTable::Find(
    const std::optional<security::ModelReference>& reference) {
  const MutexLock lock(mutex_);
  const auto name = ResolveLocked(reference);
  if (!name.ok()) return name.status();
  if (const auto found = resident_.find(*name); found != resident_.end()) {
    found->second.last_used = ++uses_;
    return found->second.handle;
  }
  if (absl::Status failed = LateLoadErrorLocked(*name); !failed.ok()) return failed;
  return ModelHandle();
}

absl::Status ServingTable::LateLoadErrorLocked(const ModelVersionName& name) const {
  const auto failed = load_errors_.find(name);
  if (failed == load_errors_.end()) return absl::OkStatus();
  const bool waits = std::chrono::steady_clock::now() < failed->second.retry_at;
  return waits ? failed->second.status : absl::OkStatus();
}

absl::StatusOr<ModelHandle> ServingTable::Load(
    const std::optional<security::ModelReference>& reference) {
  const MutexLock change(change_mutex_);
  // Whoever held the lock before may have loaded it.
  auto found = Find(reference);
  if (!found.ok() || *found != nullptr) return found;
  const absl::StatusOr<ModelVersionName> name = Resolve(reference);
  if (!name.ok()) return name.status();
  auto handle = LoadVersion(*name);
  NotifyReady();
  return handle;
}

absl::StatusOr<ModelVersionName> ServingTable::Resolve(
    const std::optional<security::ModelReference>& reference) const {
  {
    const MutexLock lock(mutex_);
    auto name = ResolveLocked(reference);
    if (!absl::IsNotFound(name.status())) return name;
  }
  if (absl::Status status = versions_.Refresh(); !status.ok()) return status;
  const MutexLock lock(mutex_);
  return ResolveLocked(reference);
}

absl::Status ServingTable::Refused(const ModelVersionName& name, const absl::Status& why) {
  absl::Status refused = Unusable(name, why);
  metrics_.CountFailedLoad();
  {
    const MutexLock lock(mutex_);
    const auto before = load_errors_.find(name);
    if (before != load_errors_.end() && before->second.status == refused) return refused;
  }
  Log(LogLevel::kError, "model refused",
      {{"model_version", name.ToString()}, {"reason", std::string(why.message())}});
  return refused;
}

absl::StatusOr<ModelHandle> ServingTable::LoadFolder(const ModelVersionName& name,
                                                     const std::filesystem::path& folder) {
  const auto start = std::chrono::steady_clock::now();
  auto model = loader_(folder);
  absl::Status status = model.status();
  ModelHandle handle;
  if (status.ok()) {
    handle = std::make_shared<ServedModel>(name, *std::move(model));
    status = handle->WarmUp();
  }
  if (!status.ok()) {
    return Refused(name, status);
  }
  const double seconds = SecondsSince(start);
  metrics_.CountLoad(seconds);
  if (!artifact::HasManifestDigest(folder)) {
    Log(LogLevel::kWarning,
        "model.json carries no digest, so damage of it may go unnoticed; a label of an action, or "
        "training anew, adds one",
        {{"model_version", name.ToString()}});
  }
  Log(LogLevel::kInfo, "model loaded",
      {{"model_version", name.ToString()},
       {"precision", handle->model().precision()},
       {"weight_bytes", handle->model().weight_bytes()},
       {"seconds", seconds}});
  return handle;
}

absl::StatusOr<ModelHandle> ServingTable::LoadVersion(const ModelVersionName& name) {
  {
    const MutexLock lock(mutex_);
    if (const auto found = resident_.find(name); found != resident_.end()) {
      return found->second.handle;
    }
  }
  if (!versions_.Contains(name)) {
    if (absl::Status status = versions_.Refresh(); !status.ok()) return status;
  }
  if (absl::Status status = versions_.CheckExists(name); !status.ok()) return status;
  auto handle = LoadFolder(name, versions_.FolderOf(name));
  std::vector<ModelHandle> dropped;  // freed after the lock
  const MutexLock lock(mutex_);
  if (!handle.ok()) {
    LoadError& failed = load_errors_[name];
    constexpr std::chrono::minutes kLongest{10};
    failed.wait = failed.status.ok() ? options_.retry_load
                                     : std::min<LoadError::Duration>(2 * failed.wait, kLongest);
    failed.status = handle.status();
    failed.retry_at = std::chrono::steady_clock::now() + failed.wait;
  } else {
    MakeResidentLocked(*handle, dropped);
  }
  return handle;
}

absl::StatusOr<ModelHandle> ServingTable::LoadChecked(const ModelVersionName& name) {
  bool is_resident = false;
  {
    const MutexLock lock(mutex_);
    is_resident = resident_.contains(name);
  }
  if (is_resident) {
    // It would answer until the server starts again, and not afterwards.
    if (absl::Status status = versions_.Refresh(); !status.ok()) return status;
    if (absl::Status status = versions_.CheckExists(name); !status.ok()) return status;
    const auto on_disk = loader_(versions_.FolderOf(name));
    if (!on_disk.ok()) return Refused(name, on_disk.status());
  }
  return LoadVersion(name);
}

void ServingTable::MakeResidentLocked(const ModelHandle& handle,
                                      std::vector<ModelHandle>& dropped) {
  resident_[handle->name()] = {handle, ++uses_};
  load_errors_.erase(handle->name());

  std::vector<std::pair<uint64_t, ModelVersionName>> unaliased;
  for (const auto& [name, resident] : resident_) {
    if (!options_.serves || AliasesOfLocked(name).empty())
      unaliased.emplace_back(resident.last_used, name);
  }
  std::ranges::sort(unaliased);
  const size_t keep =
      options_.serves ? static_cast<size_t>(options_.max_unaliased_in_memory) : size_t{0};
  for (size_t i = 0; i + keep < unaliased.size(); ++i) {
    const auto found = resident_.find(unaliased[i].second);
    dropped.push_back(std::move(found->second.handle));
    resident_.erase(found);
  }
  metrics_.SetLoaded(resident_.size());
}

std::vector<std::string> ServingTable::AliasesOf(const ModelVersionName& name) const {
  const MutexLock lock(mutex_);
  return AliasesOfLocked(name);
}

std::vector<std::string> ServingTable::AliasesOfLocked(const ModelVersionName& name) const {
  std::vector<std::string> found;  // sorted, as the map is
  for (const auto& [alias, version] : aliases_) {
    if (alias.model == name.model && version == name.version) found.push_back(alias.alias);
  }
  return found;
}

absl::StatusOr<bool> ServingTable::PointAlias(const ModelAliasName& name, const ModelHandle& handle,
                                              const AliasCondition& condition) {
  auto moved = alias_store_.SetAliasIf(name, handle->name().version, condition);
  if (!moved.ok()) return moved;
  if (!*moved) {
    if (absl::Status status = FollowStores(); !status.ok()) return status;
    return false;
  }
  Swap(name, handle);
  NotifyReady();
  return true;
}

void ServingTable::Swap(const ModelAliasName& name, const ModelHandle& handle) {
  {
    std::vector<ModelHandle> dropped;  // freed after the lock
    const MutexLock lock(mutex_);
    const int before = std::exchange(aliases_[name], handle->name().version);
    if (before != handle->name().version) metrics_.CountSwap(name.alias);
    MakeResidentLocked(handle, dropped);
  }
  Log(LogLevel::kInfo, "alias set",
      {{"alias", name.ToString()}, {"model_version", handle->name().ToString()}});
}

absl::Status ServingTable::SetAlias(const ModelAliasName& name, int version) {
  const MutexLock change(change_mutex_);
  const auto handle = LoadChecked({name.model, version});
  if (!handle.ok()) return handle.status();
  return PointAlias(name, *handle, {}).status();
}

absl::Status ServingTable::DeleteAlias(const ModelAliasName& name) {
  const MutexLock change(change_mutex_);
  if (auto status = alias_store_.DeleteAlias(name); !status.ok()) {
    if (!absl::IsNotFound(status)) return status;
    const MutexLock lock(mutex_);
    return NoAliasLocked(name);
  }
  {
    const MutexLock lock(mutex_);
    aliases_.erase(name);
  }
  Log(LogLevel::kInfo, "alias deleted", {{"alias", name.ToString()}});
  NotifyReady();
  return absl::OkStatus();
}

std::optional<ModelVersionName> ServingTable::Serving(const std::string& model) const {
  const MutexLock lock(mutex_);
  const auto alias = aliases_.find({model, std::string(kServingAlias)});
  if (alias == aliases_.end()) return std::nullopt;
  return ModelVersionName{model, alias->second};
}

absl::StatusOr<bool> ServingTable::PromoteOver(const ModelVersionName& name,
                                               const std::optional<ModelVersionName>& before,
                                               const Maker& maker) {
  const MutexLock change(change_mutex_);
  if (Serving(name.model) != before) return false;
  const auto handle = LoadChecked(name);
  if (!handle.ok()) return handle.status();
  return PointAlias({name.model, std::string(kServingAlias)}, *handle,
                    {before ? before->version : 0, maker});
}

bool ServingTable::WantsPromotion(const std::string& model, v1::Promotion promotion) const {
  if (promotion == v1::PROMOTION_ALWAYS) return true;
  return promotion == v1::PROMOTION_UNSPECIFIED && !Serving(model);
}

absl::Status ServingTable::PromotePublished(const ModelHandle& handle, v1::Promotion promotion,
                                            const Maker& maker) {
  const std::string& model = handle->name().model;
  if (Serving(model) == handle->name() || !WantsPromotion(model, promotion)) {
    return absl::OkStatus();
  }
  AliasCondition condition{.before = std::nullopt, .maker = maker};
  if (promotion == v1::PROMOTION_UNSPECIFIED) condition.before = 0;
  return PointAlias({model, std::string(kServingAlias)}, handle, condition).status();
}

absl::StatusOr<ModelVersionName> ServingTable::Publish(const std::string& model,
                                                       const std::filesystem::path& finished,
                                                       v1::Promotion promotion,
                                                       const Maker& maker) {
  const MutexLock change(change_mutex_);
  ModelHandle handle;
  const auto load = [&](const ModelVersionName& next)
                        ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_) -> absl::Status {
    auto loaded = LoadFolder(next, finished);
    absl::Status status = loaded.status();
    if (status.ok()) handle = *std::move(loaded);
    return status;
  };
  const auto name = versions_.Publish(model, finished, maker, load);
  if (!name.ok()) return name.status();
  const absl::Status status = PromotePublished(handle, promotion, maker);
  // The alias may be on its way to the database, or another attempt of the job goes on with the
  // version: it stays for them.
  if (errors::IsStoreAway(status) || absl::IsAborted(status)) return status;
  if (!status.ok()) {
    const absl::Status undone = versions_.TakeBack(*name, finished);
    if (!undone.ok()) {
      Log(LogLevel::kError, "half-registered model", {{"model_version", name->ToString()}});
    }
    return status;
  }
  Log(LogLevel::kInfo, "model registered", {{"model_version", name->ToString()}});
  return name;
}

absl::StatusOr<std::optional<ModelVersionName>> ServingTable::FindMadeBy(const std::string& model,
                                                                         v1::Promotion promotion,
                                                                         const Maker& maker) {
  const MutexLock change(change_mutex_);
  // Another server may have published it just now.
  if (absl::Status status = versions_.Refresh(); !status.ok()) return status;
  const std::optional<ModelVersionName> found = versions_.FindMadeBy(model, maker.name);
  if (found && Serving(model) != found && WantsPromotion(model, promotion)) {
    const auto handle = LoadVersion(*found);
    if (!handle.ok()) return handle.status();
    const absl::Status status = PromotePublished(*handle, promotion, maker);
    if (!status.ok()) return status;
  }
  return found;
}

absl::StatusOr<v1::Action> ServingTable::LabelAction(const ModelVersionName& name, int action_id,
                                                     const std::string& label) {
  const MutexLock change(change_mutex_);
  auto labelled = versions_.LabelAction(name, action_id, label);
  if (!labelled.ok()) return labelled;
  const auto version = versions_.Describe(name);
  if (!version.ok()) return version.status();
  const MutexLock lock(mutex_);
  if (const auto resident = resident_.find(name); resident != resident_.end()) {
    resident->second.handle->SetActionNames(evaluation::DisplayNames(version->manifest()));
  }
  return labelled;
}

absl::Status ServingTable::Delete(const ModelVersionName& name) {
  const MutexLock change(change_mutex_);
  if (absl::Status status = versions_.CheckExists(name); !status.ok()) return status;
  if (const auto aliases = AliasesOf(name); !aliases.empty()) {
    const std::string at = absl::StrCat(name.model, "@");
    return errors::WithReason(
        absl::FailedPreconditionError(absl::StrCat(
            name.ToString(), " is pointed to by ", at, absl::StrJoin(aliases, ", " + at),
            "; point each alias to another version with SetModelAlias, or remove it with "
            "DeleteModelAlias")),
        "MODEL_VERSION_IN_USE", {{"model_version", name.ToString()}});
  }
  if (absl::Status status = versions_.Delete(name); !status.ok()) return status;
  ModelHandle dropped;  // freed after the lock
  {
    const MutexLock lock(mutex_);
    load_errors_.erase(name);
    if (const auto found = resident_.find(name); found != resident_.end()) {
      dropped = std::move(found->second.handle);
      resident_.erase(found);
      metrics_.SetLoaded(resident_.size());
    }
  }
  Log(LogLevel::kInfo, "model deleted", {{"model_version", name.ToString()}});
  return absl::OkStatus();
}

}  // namespace maneuver::serving
