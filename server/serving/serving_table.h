// Decides which versions serve: keeps the aliases that point to versions, and the versions that are
// in memory.
//
// A new version is loaded and warmed up while the old one serves. Then their handles are swapped,
// and requests in progress keep the version that they began with. If a version cannot be loaded,
// nothing changes.
//
// Several servers may share the stores of versions and aliases. Then each calls Follow regularly,
// and serves what the others have decided.

#ifndef MANEUVER_SERVER_SERVING_SERVING_TABLE_H_
#define MANEUVER_SERVER_SERVING_SERVING_TABLE_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "locks/mutex.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/monitoring/metrics.h"
#include "server/security/resource_name.h"
#include "server/serving/alias_store.h"
#include "server/serving/served_model.h"
#include "server/serving/serving_table_metrics.h"
#include "server/serving/version_store.h"

namespace maneuver::serving {

// Reads a model from its folder. An error means that the version cannot serve.
using ModelLoader = std::function<absl::StatusOr<std::shared_ptr<const inference::ActionModel>>(
    const std::filesystem::path& folder)>;

struct ServingTableOptions {
  // How many versions without an alias stay in memory, because a request named them by number or an
  // alias has just moved on. Above this number the least recently used is dropped.
  int max_unaliased_in_memory = 2;
  // Whether versions stay in memory at all. Otherwise each is loaded when it is to be checked, and
  // freed after that; aliases are kept and followed in the same way, and Ready stays false.
  bool serves = true;
  // After which a version that could not be loaded is tried again; twice as long each time, up to ten
  // minutes. A damaged one is not read all the time, and a folder that has only just come to a network file system is found soon.
  std::chrono::steady_clock::duration retry_load = std::chrono::seconds(10);
};

// Safe to use from any thread. Functions marked "may take long" read weights from disk; do not call
// them on threads that serve.
class ServingTable {
 public:
  // Reads the stored aliases, but loads no version yet. `versions`, `aliases` and `metrics` must
  // outlive the table.
  static absl::StatusOr<std::unique_ptr<ServingTable>> Open(VersionStore& versions,
                                                            AliasStore& aliases, ModelLoader loader,
                                                            const ServingTableOptions& options,
                                                            monitoring::MetricRegistry& metrics);

  // Calls `listener` at once with the present answer of Ready(), and then, from any thread and one
  // call at a time, whenever it may have changed. The listener must not call functions that load
  // or change something here. nullptr removes it: once this returns, it is not called any more.
  void OnReadyChange(std::function<void(bool ready)> listener);
  // Returns whether the @serving version of at least one model is in memory.
  bool Ready() const;

  // Loads every version that an alias points to. Logs each one that cannot be loaded; Find then
  // returns its error. May take long.
  void LoadAliased();

  // Does what other servers have decided, each in the same way as if it were decided here: moves
  // and removes aliases, and shows new labels. A version that cannot be loaded leaves its alias as
  // it was, and is tried again later (ServingTableOptions::retry_load). Logs errors, once. May take long.
  void Follow();

  // Returns the version that a request refers to; without a reference, the version of the only
  // model that serves. Never reads the disk: the handle is nullptr if the version exists but is not
  // in memory; then call Load.
  // Errors: NOT_FOUND; FAILED_PRECONDITION if the version could not be loaded, or if there is no
  // reference and not exactly one model serves.
  absl::StatusOr<ModelHandle> Find(const std::optional<security::ModelReference>& reference);
  // Does the same as Find, but loads the version if it is not in memory. May take long.
  absl::StatusOr<ModelHandle> Load(const std::optional<security::ModelReference>& reference);
  // Returns the name of the version that a request refers to. Loads nothing. If it is not known
  // here, asks the store what other servers have published. Errors: as Find, but a version that
  // could not be loaded is not an error.
  absl::StatusOr<security::ModelVersionName> Resolve(
      const std::optional<security::ModelReference>& reference) const;

  // Returns the aliases whose versions are in memory, with these versions.
  std::vector<ModelAlias> Loaded() const;
  // Returns the ids of the aliases that point to a version, sorted.
  std::vector<std::string> AliasesOf(const security::ModelVersionName& name) const;
  // Returns the version that serves a model, if one does.
  std::optional<security::ModelVersionName> Serving(const std::string& model) const;

  // Points an alias to a version, which is loaded and checked first. An error changes nothing. May
  // take long.
  absl::Status SetAlias(const security::ModelAliasName& name, int version);
  // Deletes an alias. NOT_FOUND if there is no such alias.
  absl::Status DeleteAlias(const security::ModelAliasName& name);
  // Points `serving` to a version as SetAlias does, but only if `before` is the version that serves
  // the model now (nothing: if none serves). Otherwise changes nothing and returns false. May take
  // long.
  absl::StatusOr<bool> PromoteOver(const security::ModelVersionName& name,
                                   const std::optional<security::ModelVersionName>& before,
                                   const Maker& maker = {});

  // Loads and checks the finished model folder `finished`, publishes it in the store as the next
  // version of `model`, and promotes it as `promotion` says. An error changes nothing, except that
  // the version stays if its alias could not be set because the store is away or the maker's lease
  // has ended: FindMadeBy then promotes it. May take long.
  //   promotion: with PROMOTION_IF_NO_WORSE the version is not promoted here; see PromoteOver.
  //   maker: as in VersionStore::Publish.
  absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                     const std::filesystem::path& finished,
                                                     v1::Promotion promotion,
                                                     const Maker& maker = {});
  // Returns the version of `model` that Publish made for `maker`, if there is one. Promotes it as
  // Publish would have, in case the server died between the two. May take long.
  absl::StatusOr<std::optional<security::ModelVersionName>> FindMadeBy(const std::string& model,
                                                                       v1::Promotion promotion,
                                                                       const Maker& maker);

  // Labels an action as VersionStore::LabelAction does. Answers of the version carry the new name
  // from then on.
  absl::StatusOr<v1::Action> LabelAction(const security::ModelVersionName& name, int action_id,
                                         const std::string& label);

  // Removes a version from memory and from the store. FAILED_PRECONDITION while an alias points to
  // it. Errors: also those of VersionStore::Delete.
  absl::Status Delete(const security::ModelVersionName& name);

 private:
  struct Resident {
    ModelHandle handle;
    uint64_t last_used = 0;  // of uses_
    int64_t revision = -1;   // of its labels, as VersionStore::Revision; -1: not followed yet
  };
  // Why a version could not be loaded, and when to try again: what was away may be back.
  struct LoadError {
    using Duration = std::chrono::steady_clock::duration;
    absl::Status status;
    std::chrono::steady_clock::time_point retry_at;
    Duration wait{};  // before that; longer each time
  };

  ServingTable(VersionStore& versions, AliasStore& aliases, ModelLoader loader,
               const ServingTableOptions& options, monitoring::MetricRegistry& metrics);

  absl::StatusOr<security::ModelVersionName> ResolveLocked(
      const std::optional<security::ModelReference>& reference) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns NOT_FOUND for an alias, or a model, that does not exist. The message names the aliases
  // that the model has, and ends with `advice`.
  absl::Status NoAliasLocked(const security::ModelAliasName& name,
                             absl::string_view advice = "") const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns the error of a call that names no model while several serve. It names those.
  absl::Status NotNamedLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::vector<std::string> AliasesOfLocked(const security::ModelVersionName& name) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void MakeResidentLocked(const ModelHandle& handle, std::vector<ModelHandle>& dropped)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_, mutex_);

  // Reads the aliases, and moves those that changed.
  absl::Status FollowStores() ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Returns whether the alias points to `version` here now.
  bool FollowAlias(const security::ModelAliasName& name, int version)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  void FollowLabels() ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Returns why a version could not be loaded lately; OK if it was, or is to be tried.
  absl::Status LateLoadErrorLocked(const security::ModelVersionName& name) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<ModelHandle> LoadVersion(const security::ModelVersionName& name)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Does the same, and checks what is on the disk also if the version is in memory.
  absl::StatusOr<ModelHandle> LoadChecked(const security::ModelVersionName& name)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Counts a version that cannot be loaded, and logs it if that is news. Returns what callers get.
  absl::Status Refused(const security::ModelVersionName& name, const absl::Status& why)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  absl::StatusOr<ModelHandle> LoadFolder(const security::ModelVersionName& name,
                                         const std::filesystem::path& folder)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Points an alias to a version, in the store and here. Returns false, after following what the
  // store says, if the condition does not hold.
  absl::StatusOr<bool> PointAlias(const security::ModelAliasName& name, const ModelHandle& handle,
                                  const AliasCondition& condition)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Makes a version serve that was just published, if it is to. OK if it is not.
  absl::Status PromotePublished(const ModelHandle& handle, v1::Promotion promotion,
                                const Maker& maker) ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Points an alias here.
  void Swap(const security::ModelAliasName& name, const ModelHandle& handle)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Returns whether publishing a version of `model` makes it serve.
  bool WantsPromotion(const std::string& model, v1::Promotion promotion) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  void NotifyReady() ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);

  VersionStore& versions_;
  AliasStore& alias_store_;
  const ModelLoader loader_;
  const ServingTableOptions options_;

  // Held while something changes or loads, one at a time. Also taken before the store's own.
  Mutex change_mutex_ ABSL_ACQUIRED_BEFORE(mutex_);
  std::function<void(bool)> listener_ ABSL_GUARDED_BY(change_mutex_);
  ServingTableMetrics metrics_ ABSL_GUARDED_BY(change_mutex_);
  absl::Status last_failure_ ABSL_GUARDED_BY(change_mutex_);  // of Follow
  // Held for look-ups alone, never while the disk is read.
  mutable Mutex mutex_;
  std::map<security::ModelAliasName, int> aliases_ ABSL_GUARDED_BY(mutex_);
  std::map<security::ModelVersionName, Resident> resident_ ABSL_GUARDED_BY(mutex_);
  std::map<security::ModelVersionName, LoadError> load_errors_ ABSL_GUARDED_BY(mutex_);
  uint64_t uses_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SERVING_TABLE_H_
