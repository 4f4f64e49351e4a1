// The versions of models on disk:
//
//   {folder}/{model}/{version}/       one version: model.json, weights.safetensors; made_by, the
//                                     name of the job that made it; evaluations, its reports
//                                     (evaluation_files.h)
//   {folder}/{model}/.last_version    the highest number ever given, written when that version is
//                                     deleted, so that a number is never given again
//
// Several servers may share the folder. Then, and wherever there is a ledger (version_ledger.h), it
// says which versions exist and which numbers were given.
//
// Knows nothing of aliases or of versions in memory: ServingTable does.

#ifndef MANEUVER_SERVER_SERVING_VERSION_STORE_H_
#define MANEUVER_SERVER_SERVING_VERSION_STORE_H_

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
#include "locks/mutex.h"
#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/model.pb.h"
#include "server/security/resource_name.h"
#include "server/serving/maker.h"
#include "server/serving/version_ledger.h"

namespace maneuver::serving {

// Safe to use from any thread. Changes run one at a time. Contains and ContainsModel never touch
// the disk.
class VersionStore {
 public:
  // Opens `folder` (DATA/models) and lists its versions. Creates the folder if it is missing, and
  // removes what interrupted writers left. Leaves entries with other names alone.
  //   ledger: must outlive the store; versions in the folder that it does not know are added to it.
  //     nullptr: no other server uses the folder.
  static absl::StatusOr<std::unique_ptr<VersionStore>> Open(std::filesystem::path folder,
                                                            VersionLedger* ledger = nullptr);

  // Learns of the versions that other servers have published, changed or deleted. Without a ledger
  // it does nothing.
  absl::Status Refresh();

  bool Contains(const security::ModelVersionName& name) const;
  // Returns whether the model has any version.
  bool ContainsModel(const std::string& model) const;
  // Returns a number that a Refresh increases if the labels or reports of the version have changed
  // since the Refresh before; always 0 without a ledger.
  int64_t Revision(const security::ModelVersionName& name) const;
  // Returns OK if the version exists; else NOT_FOUND with the reason MODEL_VERSION_NOT_FOUND.
  absl::Status CheckExists(const security::ModelVersionName& name) const;
  // Returns where the version is, or would be.
  std::filesystem::path FolderOf(const security::ModelVersionName& name) const;

  struct StoredVersion {
    security::ModelVersionName name;
    std::chrono::system_clock::time_point create_time;  // when it was published
  };
  // Lists the versions of one model, or of all models if `model` is empty; newest first.
  std::vector<StoredVersion> List(const std::string& model) const;
  // Returns the name of the maker that Publish stamped the version with; empty if there is none.
  std::string MakerOf(const security::ModelVersionName& name) const;
  // Returns the latest version of `model` that Publish stamped with `maker`, if there is one.
  std::optional<security::ModelVersionName> FindMadeBy(const std::string& model,
                                                       const std::string& maker) const;
  // Returns what is stored of a version, without its aliases. Reads model.json. Errors: NOT_FOUND;
  // FAILED_PRECONDITION with the reason MODEL_DAMAGED.
  absl::StatusOr<v1::ModelVersion> Describe(const security::ModelVersionName& name) const;

  // Called with the name that a version is about to get. An error keeps it from being published.
  using Check = std::function<absl::Status(const security::ModelVersionName& name)>;
  // Moves `finished`, a complete model folder on the same file system, to its place as the next
  // version of `model`. After an error or a crash the version exists completely or not at all.
  //   maker: its name is for FindMadeBy.
  //   check: examines `finished` before anything changes; must not call functions that change this
  //     store.
  // Errors: INVALID_ARGUMENT if `model` is not a resource id; those of `check`, of files and of the
  // ledger. With a ledger, an error may use up a number; and if the ledger cannot be reached, the
  // version may exist: FindMadeBy then says.
  absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                     const std::filesystem::path& finished,
                                                     const Maker& maker, const Check& check);
  // Undoes Publish: moves the folder back to `finished` and forgets the version.
  absl::Status TakeBack(const security::ModelVersionName& name,
                        const std::filesystem::path& finished);
  // Removes a version. Its number is never given again. Errors: NOT_FOUND; those of files and of
  // the ledger.
  absl::Status Delete(const security::ModelVersionName& name);

  // Stores a report, without its sampled examples, beside the version that it names, in place of an
  // earlier one on the same dataset. Errors: INVALID_ARGUMENT for a wrong name of version or
  // dataset; NOT_FOUND if there is no such version; RESOURCE_EXHAUSTED if the disk is full, or
  // another error of files: the earlier report is then still there. Those of the ledger.
  absl::Status KeepReport(const v1::EvaluationReport& report, const Maker& maker = {});
  // Lists the reports of a version, newest first, without strata, reliability, rivals and the use
  // of actions. Logs and leaves out those that are damaged. Errors: NOT_FOUND.
  absl::StatusOr<std::vector<v1::EvaluationReport>> ListReports(
      const security::ModelVersionName& name) const;
  // Returns the report of a version on a dataset. Errors: NOT_FOUND, also if the version was not
  // evaluated on that dataset; FAILED_PRECONDITION with the reason EVALUATION_DAMAGED.
  absl::StatusOr<v1::EvaluationReport> GetReport(const security::EvaluationName& name) const;

  // Names an action; an empty label removes its name. Errors: as Describe; OUT_OF_RANGE if the
  // version has no such action; those of files.
  absl::StatusOr<v1::Action> LabelAction(const security::ModelVersionName& name, int action_id,
                                         const std::string& label);

 private:
  VersionStore(std::filesystem::path folder, VersionLedger* ledger)
      : folder_(std::move(folder)), ledger_(ledger) {}

  absl::Status Scan();
  // Returns the versions that are in the folder.
  absl::StatusOr<std::vector<security::ModelVersionName>> ListFolder() const;
  // Adds to the ledger what the folder has from the time before there was one.
  absl::Status Adopt(const std::vector<security::ModelVersionName>& present);
  // Removes what interrupted writers left in a folder.
  absl::Status RemoveLeftovers(const std::filesystem::path& folder) const;
  // Calls `edit`, which changes files of a version.
  absl::Status Change(const security::ModelVersionName& name, const Maker& maker,
                      const std::function<absl::Status()>& edit)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  std::filesystem::path LastVersionFile(const std::string& model) const;
  std::chrono::system_clock::time_point CreateTime(const security::ModelVersionName& name) const;
  // Returns the number after the highest that `model` ever had.
  absl::StatusOr<int> NextVersion(const std::string& model) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  absl::Status MoveIn(const security::ModelVersionName& name, const std::filesystem::path& finished,
                      const std::string& maker) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  absl::Status MoveOut(const security::ModelVersionName& name) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  // Writes .last_version if this is the highest number.
  absl::Status RememberNumber(const security::ModelVersionName& name) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);
  void Forget(const security::ModelVersionName& name) ABSL_EXCLUSIVE_LOCKS_REQUIRED(change_mutex_);

  const std::filesystem::path folder_;
  VersionLedger* const ledger_;
  // Held during a change.
  Mutex change_mutex_ ABSL_ACQUIRED_BEFORE(mutex_);
  // Held for look-ups alone, never while the disk is read.
  mutable Mutex mutex_;
  // By model and version: the revision.
  std::map<std::string, std::map<int, int64_t>> versions_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_STORE_H_
