// The versions of models on disk, the aliases that point to them, and those that are in memory.
//
// Versions are loaded and warmed up beside what serves, then swapped by handle: requests in flight
// keep theirs. A version that does not load changes nothing.

#ifndef MANEUVER_SERVER_SERVING_MODEL_REGISTRY_H_
#define MANEUVER_SERVER_SERVING_MODEL_REGISTRY_H_

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/monitoring/metrics.h"
#include "server/security/resource_name.h"
#include "server/serving/alias_store.h"
#include "server/serving/registry_metrics.h"
#include "server/serving/served_model.h"
#include "server/serving/version_folders.h"

namespace maneuver::serving {

using ModelLoader = std::function<absl::StatusOr<std::shared_ptr<const inference::ActionModel>>(
    const std::filesystem::path& folder)>;

struct ModelRegistryOptions {
  // Versions in memory that no alias points to (asked for by number, or just replaced). The least
  // recently used is dropped beyond that.
  int max_unaliased_in_memory = 2;
};

// Safe to use from any thread. Functions marked "may take long" read weights from disk: they are
// not for threads that serve.
class ModelRegistry {
 public:
  // Removes what interrupted writers left in `folder` (DATA/models; created if need be) and lists
  // what is there. Loads nothing yet.
  static absl::StatusOr<std::unique_ptr<ModelRegistry>> Open(std::filesystem::path folder,
                                                             AliasStore& aliases,
                                                             ModelLoader loader,
                                                             const ModelRegistryOptions& options,
                                                             monitoring::MetricRegistry& metrics);

  // Called at once, and then from any thread whenever the answer of Ready() may have changed, one
  // call at a time. nullptr: nobody listens any more, from the return of this function on.
  void OnReadyChange(std::function<void(bool ready)> listener);
  // Whether some model's @serving version is in memory.
  bool Ready() const;

  // Loads every version that an alias points to. One that does not load is logged, and says why
  // when it is asked for. May take long.
  void LoadAliased();

  // The version that a request means. No reference: the only model that serves. Never touches the
  // disk: the handle is nullptr if the version is there but not in memory; then call Load.
  // Errors: NOT_FOUND; FAILED_PRECONDITION if it did not load, or if nothing or more than one model
  // serves and none was named.
  absl::StatusOr<ModelHandle> Find(const std::optional<security::ModelReference>& reference);
  // Likewise, but loads it. May take long.
  absl::StatusOr<ModelHandle> Load(const std::optional<security::ModelReference>& reference);

  struct ResolvedVersion {
    security::ModelVersionName name;
    std::filesystem::path folder;
  };
  // The version that a request means, and where it is. Loads nothing. Errors: as Find, but a
  // version that did not load is returned as well.
  absl::StatusOr<ResolvedVersion> Resolve(
      const std::optional<security::ModelReference>& reference) const;

  // Makes the finished model folder `finished` (on the same file system) the next version of
  // `model`. It is loaded and checked first: if it is damaged nothing changes. May take long.
  //   promotion: with PROMOTION_IF_NO_WORSE the version does not serve yet: see PromoteOver.
  //   maker: who made it, kept beside it for FindMadeBy; empty: nobody says.
  absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                     const std::filesystem::path& finished,
                                                     v1::Promotion promotion,
                                                     const std::string& maker = {});
  // The version of `model` that Publish made for `maker`, if there is one, promoted as Publish
  // would have: a server that dies in Publish, or before it can tell of it, leaves the old state or
  // this one. May take long.
  absl::StatusOr<std::optional<security::ModelVersionName>> FindMadeBy(const std::string& model,
                                                                       v1::Promotion promotion,
                                                                       const std::string& maker);

  // Points an alias to a version, which is loaded and checked first: if it is damaged, or cannot be
  // stored, all stays as it was. May take long.
  absl::Status SetAlias(const security::ModelAliasName& name, int version);
  absl::Status DeleteAlias(const security::ModelAliasName& name);
  // The version that serves a model; nothing: none does.
  std::optional<security::ModelVersionName> Serving(const std::string& model) const;
  // Points `serving` to a version as SetAlias does, but only as long as `before` serves its model
  // (nothing: none does). False, and all stays as it was, if another one does by now. May take
  // long.
  absl::StatusOr<bool> PromoteOver(const security::ModelVersionName& name,
                                   const std::optional<security::ModelVersionName>& before);

  // Removes a version from disk. FAILED_PRECONDITION while an alias points to it.
  absl::Status Delete(const security::ModelVersionName& name);

  struct VersionInfo {
    security::ModelVersionName name;
    std::chrono::system_clock::time_point create_time;
    std::vector<std::string> aliases;  // ids, sorted
  };
  // Newest first; of one model, or of all if `model` is empty.
  std::vector<VersionInfo> List(const std::string& model) const;

  // What is stored of a version. Reads model.json. Errors: NOT_FOUND; FAILED_PRECONDITION with the
  // reason if it is damaged.
  absl::StatusOr<v1::ModelVersion> Describe(const security::ModelVersionName& name) const;

  // Keeps a report beside the version that it names (evaluation_files.h), in place of one on the
  // same dataset. Errors: NOT_FOUND if there is no such version; RESOURCE_EXHAUSTED if the disk is
  // full, or another error of files; the report before is then still there.
  absl::Status KeepReport(const v1::EvaluationReport& report);
  // What a version was evaluated on, newest first, without strata, reliability and what actions
  // were used for. One that is damaged is logged and left out. Errors: NOT_FOUND.
  absl::StatusOr<std::vector<v1::EvaluationReport>> ListReports(
      const security::ModelVersionName& name) const;
  // Errors: NOT_FOUND, also where the version was not evaluated on that dataset;
  // FAILED_PRECONDITION if it is damaged.
  absl::StatusOr<v1::EvaluationReport> GetReport(const security::EvaluationName& name) const;

  // Names an action; an empty label removes it. Errors: as Describe, and OUT_OF_RANGE.
  absl::StatusOr<v1::Action> LabelAction(const security::ModelVersionName& name, int action_id,
                                         const std::string& label);

 private:
  struct Resident {
    ModelHandle handle;
    uint64_t last_used = 0;  // of uses_
  };

  ModelRegistry(std::filesystem::path folder, AliasStore& aliases, ModelLoader loader,
                const ModelRegistryOptions& options, monitoring::MetricRegistry& metrics);

  // These want mutex_ held.
  absl::StatusOr<security::ModelVersionName> ResolveLocked(
      const std::optional<security::ModelReference>& reference) const;
  bool ReadyLocked() const;
  bool WantsPromotionLocked(const std::string& model, v1::Promotion promotion) const;
  std::vector<std::string> AliasesOfLocked(const security::ModelVersionName& name) const;
  void MakeResidentLocked(const ModelHandle& handle, std::vector<ModelHandle>& dropped);

  // These want change_mutex_ held.
  absl::StatusOr<ModelHandle> LoadVersion(const security::ModelVersionName& name);
  absl::StatusOr<ModelHandle> LoadFolder(const security::ModelVersionName& name,
                                         const std::filesystem::path& folder);
  absl::Status PointAlias(const security::ModelAliasName& name, const ModelHandle& handle);
  void NotifyReady();

  const VersionFolders folders_;
  AliasStore& alias_store_;
  const ModelLoader loader_;
  const ModelRegistryOptions options_;

  // Held while something changes or loads, one at a time; taken before mutex_.
  mutable std::mutex change_mutex_;
  std::function<void(bool)> listener_;  // guarded by change_mutex_
  RegistryMetrics metrics_;             // guarded by change_mutex_, but what is safe anyway
  // Guards what follows; held for look-ups alone, never while the disk is read.
  mutable std::mutex mutex_;
  std::map<std::string, std::set<int>> versions_;  // by model; what is on disk
  std::map<security::ModelAliasName, int> aliases_;
  std::map<security::ModelVersionName, Resident> resident_;
  std::map<security::ModelVersionName, absl::Status> load_errors_;
  uint64_t uses_ = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_MODEL_REGISTRY_H_
