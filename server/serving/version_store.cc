#include "server/serving/version_store.h"

#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_cost.h"
#include "model/artifact/model_folder.h"
#include "model/evaluation/action_names.h"
#include "model/files/abandoned_temporaries.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/files/file_system_failure.h"
#include "server/errors/error_details.h"
#include "server/monitoring/logging.h"
#include "server/serving/evaluation_files.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;
using security::EvaluationName;
using security::ModelVersionName;

constexpr char kMaker[] = "made_by";
constexpr char kLastVersion[] = ".last_version";
// Written once when a model is exported and never again, unlike model.json. Its modification time
// is free to say when the version was published.
constexpr char kWeights[] = "weights.safetensors";

absl::Status FileError(const char* what, const std::error_code& error) {
  const absl::Status status = files::ErrnoStatus(error.value(), what, "");
  if (files::IsFileSystemFailure(status)) return errors::WithFolderReason(status, "models");
  return absl::InternalError(absl::StrCat("cannot ", what, ": ", error.message()));
}

// Returns what is in a folder of models or of versions. One that another server has deleted meanwhile
// is empty.
absl::StatusOr<std::vector<fs::path>> Entries(const fs::path& folder) {
  auto entries = files::ListFolder(folder);
  if (absl::IsNotFound(entries.status())) return std::vector<fs::path>();
  if (entries.ok()) return entries;
  return errors::WithFolderReason(entries.status(), "models");
}

// Something that cannot be looked at, such as a link that leads nowhere, is none.
bool IsFolder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error);
}

// A label that another action shows would make tables, and callers that ask by name, ambiguous.
absl::Status CheckLabel(const v1::ModelManifest& manifest, int action_id,
                        const std::string& label) {
  if (label.empty()) return absl::OkStatus();
  const std::vector<std::string> names = evaluation::DisplayNames(manifest);
  for (size_t k = 0; k < names.size(); ++k) {
    if (static_cast<int>(k) == action_id || names[k] != label) continue;
    return errors::InvalidField(
        "label", absl::StrCat("is the name of action ", k, "; names of a version differ"));
  }
  return absl::OkStatus();
}

// Sets the report's names by where it is stored: a version's folder may have come from another
// server.
v1::EvaluationReport Named(v1::EvaluationReport report, const EvaluationName& name) {
  report.set_name(name.ToString());
  report.set_model_version(name.version.ToString());
  return report;
}

google::protobuf::Timestamp ToTimestamp(std::chrono::system_clock::time_point time) {
  return google::protobuf::util::TimeUtil::NanosecondsToTimestamp(
      std::chrono::duration_cast<std::chrono::nanoseconds>(time.time_since_epoch()).count());
}

}  // namespace

absl::StatusOr<std::unique_ptr<VersionStore>> VersionStore::Open(fs::path folder,
                                                                 VersionLedger* ledger) {
  std::unique_ptr<VersionStore> store(new VersionStore(std::move(folder), ledger));
  if (absl::Status status = store->Scan(); !status.ok()) return status;
  return store;
}

absl::Status VersionStore::Scan() {
  const auto present = ListFolder();
  if (!present.ok()) return present.status();
  if (ledger_ != nullptr) {
    absl::Status status = Adopt(*present);
    return status.ok() ? Refresh() : status;
  }
  const MutexLock lock(mutex_);
  for (const ModelVersionName& name : *present) versions_[name.model].emplace(name.version, 0);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<ModelVersionName>> VersionStore::ListFolder() const {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return FileError("create the folder of models", error);
  if (auto status = RemoveLeftovers(folder_); !status.ok()) return status;

  const auto models = Entries(folder_);
  if (!models.ok()) return models.status();
  std::vector<ModelVersionName> found;
  for (const fs::path& model : *models) {
    const std::string id = model.filename();
    if (!security::IsResourceId(id) || !IsFolder(model)) continue;
    if (auto status = RemoveLeftovers(model); !status.ok()) return status;
    const auto versions = Entries(model);
    if (!versions.ok()) return versions.status();
    for (const fs::path& version : *versions) {
      const int number = security::ParseVersion(version.filename().string());
      if (number == 0 || !IsFolder(version)) continue;
      found.push_back({id, number});
      // Left by a label that was being written, and by a report.
      if (auto status = RemoveLeftovers(version); !status.ok()) return status;
      const fs::path evaluations = EvaluationsFolder(version);
      if (!IsFolder(evaluations)) continue;
      if (auto status = RemoveLeftovers(evaluations); !status.ok()) return status;
    }
  }
  return found;
}

absl::Status VersionStore::RemoveLeftovers(const fs::path& folder) const {
  if (ledger_ == nullptr) return files::RemoveTemporaries(folder);
  files::RemoveAbandonedTemporaries(folder, fs::file_time_type::clock::now());
  return absl::OkStatus();
}

absl::Status VersionStore::Adopt(const std::vector<ModelVersionName>& present) {
  if (absl::Status status = Refresh(); !status.ok()) return status;
  std::vector<ModelVersionName> unknown;
  for (const ModelVersionName& name : present) {
    if (!Contains(name)) unknown.push_back(name);
  }
  if (absl::Status status = ledger_->Adopt(unknown); !status.ok()) return status;
  const auto models = Entries(folder_);
  if (!models.ok()) return models.status();
  std::vector<ModelVersionName> deleted;
  for (const fs::path& model : *models) {
    const std::string id = model.filename();
    if (!security::IsResourceId(id)) continue;
    const auto last = files::ReadFile(LastVersionFile(id));
    if (last.ok()) deleted.push_back({id, security::ParseVersion(*last)});
  }
  return ledger_->AdoptDeleted(deleted);
}

absl::Status VersionStore::Refresh() {
  if (ledger_ == nullptr) return absl::OkStatus();
  // A version that is published here meanwhile is not lost.
  const MutexLock change(change_mutex_);
  const auto listed = ledger_->ListVersions();
  if (!listed.ok()) return listed.status();
  std::map<std::string, std::map<int, int64_t>> versions;
  for (const auto& [name, revision] : *listed) versions[name.model][name.version] = revision;
  const MutexLock lock(mutex_);
  versions_ = std::move(versions);
  return absl::OkStatus();
}

int64_t VersionStore::Revision(const ModelVersionName& name) const {
  const MutexLock lock(mutex_);
  const auto model = versions_.find(name.model);
  if (model == versions_.end()) return 0;
  const auto version = model->second.find(name.version);
  return version == model->second.end() ? 0 : version->second;
}

bool VersionStore::Contains(const ModelVersionName& name) const {
  const MutexLock lock(mutex_);
  const auto model = versions_.find(name.model);
  return model != versions_.end() && model->second.contains(name.version);
}

bool VersionStore::ContainsModel(const std::string& model) const {
  const MutexLock lock(mutex_);
  return versions_.contains(model);
}

absl::Status VersionStore::CheckExists(const ModelVersionName& name) const {
  if (Contains(name)) return absl::OkStatus();
  return errors::WithReason(
      absl::NotFoundError(absl::StrCat("there is no ", name.ToString(),
                                       "; ListModelVersions names those that exist")),
      "MODEL_VERSION_NOT_FOUND", {{"model_version", name.ToString()}});
}

fs::path VersionStore::FolderOf(const ModelVersionName& name) const {
  return folder_ / name.model / std::to_string(name.version);
}

fs::path VersionStore::LastVersionFile(const std::string& model) const {
  return folder_ / model / kLastVersion;
}

std::chrono::system_clock::time_point VersionStore::CreateTime(const ModelVersionName& name) const {
  std::error_code error;
  const auto time = fs::last_write_time(FolderOf(name) / kWeights, error);
  return error ? std::chrono::system_clock::time_point() : std::chrono::file_clock::to_sys(time);
}

std::vector<VersionStore::StoredVersion> VersionStore::List(const std::string& model) const {
  std::vector<StoredVersion> found;
  {
    const MutexLock lock(mutex_);
    for (const auto& [id, versions] : versions_) {
      if (!model.empty() && id != model) continue;
      for (const auto& [version, revision] : versions) found.push_back({{id, version}, {}});
    }
  }
  for (StoredVersion& version : found) version.create_time = CreateTime(version.name);
  std::ranges::sort(found, [](const StoredVersion& a, const StoredVersion& b) {
    if (a.create_time != b.create_time) return a.create_time > b.create_time;
    if (a.name.model != b.name.model) return a.name.model < b.name.model;
    return a.name.version > b.name.version;
  });
  return found;
}

std::string VersionStore::MakerOf(const ModelVersionName& name) const {
  return files::ReadFile(FolderOf(name) / kMaker).value_or("");
}

std::optional<ModelVersionName> VersionStore::FindMadeBy(const std::string& model,
                                                         const std::string& maker) const {
  std::map<int, int64_t> versions;
  {
    const MutexLock lock(mutex_);
    const auto found = versions_.find(model);
    if (found == versions_.end()) return std::nullopt;
    versions = found->second;
  }
  std::optional<ModelVersionName> latest;
  for (const auto& [version, revision] : versions) {
    const ModelVersionName name{model, version};
    if (MakerOf(name) == maker) latest = name;
  }
  return latest;
}

absl::StatusOr<v1::ModelVersion> VersionStore::Describe(const ModelVersionName& name) const {
  if (absl::Status status = CheckExists(name); !status.ok()) return status;
  auto manifest = artifact::ReadModelManifest(FolderOf(name));
  if (files::IsFileSystemFailure(manifest.status())) {
    return errors::WithFolderReason(manifest.status(), "models");
  }
  if (!manifest.ok()) {
    return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                  name.ToString(), " is damaged: ", manifest.status().message())),
                              "MODEL_DAMAGED", {{"model_version", name.ToString()}});
  }
  v1::ModelVersion version;
  version.set_name(name.ToString());
  *version.mutable_cost() = artifact::CountCost(manifest->spec());
  evaluation::CompleteActionNames(*manifest);
  *version.mutable_manifest() = *std::move(manifest);
  *version.mutable_create_time() = ToTimestamp(CreateTime(name));
  return version;
}

absl::StatusOr<int> VersionStore::NextVersion(const std::string& model) const {
  int last = 0;
  {
    const MutexLock lock(mutex_);
    const auto found = versions_.find(model);
    if (found != versions_.end()) last = found->second.rbegin()->first;
  }
  const auto recorded = files::ReadFile(LastVersionFile(model));
  if (recorded.ok()) {
    last = std::max(last, security::ParseVersion(*recorded));
  } else if (!absl::IsNotFound(recorded.status())) {
    return recorded.status();
  }
  return last + 1;
}

absl::StatusOr<ModelVersionName> VersionStore::Publish(const std::string& model,
                                                       const fs::path& finished, const Maker& maker,
                                                       const Check& check) {
  if (!security::IsResourceId(model)) {
    return absl::InvalidArgumentError("a model's name is [a-z][a-z0-9-]*, at most 63 characters");
  }
  const MutexLock change(change_mutex_);
  const auto number = ledger_ != nullptr ? ledger_->Reserve(model, maker) : NextVersion(model);
  if (!number.ok()) return number.status();
  const ModelVersionName name{model, *number};
  if (absl::Status status = check(name); !status.ok()) return status;
  if (absl::Status status = MoveIn(name, finished, maker.name); !status.ok()) {
    // If only syncing failed, the folder is in place: nobody may see it, and it would be in the way
    // of the next version.
    std::error_code ignored;
    if (!fs::exists(finished, ignored)) fs::rename(FolderOf(name), finished, ignored);
    return status;
  }
  if (ledger_ != nullptr) {
    const absl::Status status = ledger_->Announce(name, maker);
    // If the ledger is away, it may have heard: the folder stays for it.
    if (!status.ok() && !errors::IsStoreAway(status)) {
      std::error_code ignored;  // nobody sees the folder
      fs::rename(FolderOf(name), finished, ignored);
    }
    if (!status.ok()) return status;
  }
  const MutexLock lock(mutex_);
  versions_[model].emplace(name.version, 0);
  return name;
}

absl::Status VersionStore::MoveIn(const ModelVersionName& name, const fs::path& finished,
                                  const std::string& maker) const {
  std::error_code error;
  if (!maker.empty()) {
    if (auto status = files::WriteFileAtomically(finished / kMaker, maker); !status.ok()) {
      return status;
    }
  }
  fs::create_directories(folder_ / name.model, error);
  if (error) return FileError("create the folder of a model", error);
  const auto now = std::chrono::file_clock::from_sys(std::chrono::system_clock::now());
  fs::last_write_time(finished / kWeights, now, error);
  if (error) return FileError("stamp a model", error);
  if (auto status = files::PublishFolder(finished, FolderOf(name)); !status.ok()) return status;
  return files::SyncPath(folder_);
}

absl::Status VersionStore::TakeBack(const ModelVersionName& name, const fs::path& finished) {
  const MutexLock change(change_mutex_);
  if (ledger_ != nullptr) {
    if (absl::Status status = ledger_->Retract(name); !status.ok()) return status;
  }
  Forget(name);
  std::error_code error;
  fs::rename(FolderOf(name), finished, error);
  return error ? FileError("take back a model version", error) : absl::OkStatus();
}

absl::Status VersionStore::Delete(const ModelVersionName& name) {
  const MutexLock change(change_mutex_);
  if (absl::Status status = CheckExists(name); !status.ok()) return status;
  absl::Status status = ledger_ != nullptr ? ledger_->Retract(name) : RememberNumber(name);
  if (status.ok()) status = MoveOut(name);
  // If only syncing failed, the folder is gone from its place.
  std::error_code ignored;
  if (!fs::exists(FolderOf(name), ignored)) Forget(name);
  return status;
}

absl::Status VersionStore::RememberNumber(const ModelVersionName& name) const {
  const auto next = NextVersion(name.model);
  if (!next.ok()) return next.status();
  if (*next != name.version + 1) return absl::OkStatus();
  return files::WriteFileAtomically(LastVersionFile(name.model), std::to_string(name.version));
}

absl::Status VersionStore::MoveOut(const ModelVersionName& name) const {
  // Out of sight in one step, then file by file: a crash in between leaves a temporary.
  const auto aside = files::MoveAside(FolderOf(name));
  if (!aside.ok()) return aside.status();
  std::error_code ignored;
  fs::remove_all(*aside, ignored);
  return absl::OkStatus();
}

void VersionStore::Forget(const ModelVersionName& name) {
  const MutexLock lock(mutex_);
  const auto model = versions_.find(name.model);
  if (model == versions_.end()) return;
  model->second.erase(name.version);
  if (model->second.empty()) versions_.erase(model);
}

absl::Status VersionStore::Change(const ModelVersionName& name, const Maker& maker,
                                  const std::function<absl::Status()>& edit) {
  return ledger_ != nullptr ? ledger_->Change(name, maker, edit) : edit();
}

absl::Status VersionStore::KeepReport(const v1::EvaluationReport& report, const Maker& maker) {
  const auto version = security::ParseModelVersionName(report.model_version(), "model_version");
  if (!version.ok()) return version.status();
  const auto dataset = security::ParseDatasetName(report.dataset(), "dataset");
  if (!dataset.ok()) return dataset.status();
  v1::EvaluationReport kept = Named(report, {*version, *dataset});
  kept.clear_sampled_examples();
  // Nobody deletes the version meanwhile.
  const MutexLock change(change_mutex_);
  if (absl::Status status = CheckExists(*version); !status.ok()) return status;
  return Change(*version, maker,
                [&] { return WriteEvaluation(FolderOf(*version), *dataset, kept); });
}

absl::StatusOr<std::vector<v1::EvaluationReport>> VersionStore::ListReports(
    const ModelVersionName& name) const {
  if (absl::Status status = CheckExists(name); !status.ok()) return status;
  std::vector<v1::EvaluationReport> reports;
  for (const std::string& dataset : ListEvaluations(FolderOf(name))) {
    absl::StatusOr<v1::EvaluationReport> report = GetReport({name, dataset});
    if (!report.ok()) {
      monitoring::Log(monitoring::LogLevel::kWarning, "report left out",
                      {{"evaluation", EvaluationName{name, dataset}.ToString()},
                       {"reason", std::string(report.status().message())}});
      continue;
    }
    report->clear_action_usage();
    report->clear_reliability();
    report->clear_strata();
    report->clear_action_uses();
    report->clear_rivals();
    reports.push_back(*std::move(report));
  }
  const auto nanoseconds = [](const v1::EvaluationReport& report) {
    return google::protobuf::util::TimeUtil::TimestampToNanoseconds(report.create_time());
  };
  std::ranges::stable_sort(
      reports, [&](const auto& a, const auto& b) { return nanoseconds(a) > nanoseconds(b); });
  return reports;
}

absl::StatusOr<v1::EvaluationReport> VersionStore::GetReport(const EvaluationName& name) const {
  if (absl::Status status = CheckExists(name.version); !status.ok()) return status;
  absl::StatusOr<v1::EvaluationReport> report =
      ReadEvaluation(FolderOf(name.version), name.evaluation);
  if (absl::IsNotFound(report.status())) {
    return errors::WithReason(
        absl::NotFoundError(absl::StrCat(name.version.ToString(), " was not evaluated on datasets/",
                                         name.evaluation, "; evaluate it first")),
        "EVALUATION_NOT_FOUND", {{"evaluation", name.ToString()}});
  }
  if (files::IsFileSystemFailure(report.status())) {
    return errors::WithFolderReason(report.status(), "models");
  }
  if (!report.ok()) {
    return errors::WithReason(absl::FailedPreconditionError(absl::StrCat(
                                  name.ToString(), " is damaged; evaluate the version again")),
                              "EVALUATION_DAMAGED", {{"evaluation", name.ToString()}});
  }
  return Named(*std::move(report), name);
}

absl::StatusOr<v1::Action> VersionStore::LabelAction(const ModelVersionName& name, int action_id,
                                                     const std::string& label) {
  const MutexLock change(change_mutex_);
  if (absl::Status status = CheckExists(name); !status.ok()) return status;
  v1::Action labelled;
  const absl::Status status = Change(name, {}, [&]() -> absl::Status {
    auto version = Describe(name);
    if (!version.ok()) return version.status();
    v1::ModelManifest& manifest = *version->mutable_manifest();
    const auto action = std::ranges::find(*manifest.mutable_actions(), action_id,
                                          [](const v1::Action& a) { return a.action_id(); });
    if (action == manifest.mutable_actions()->end()) {
      return absl::OutOfRangeError(
          absl::StrCat(name.ToString(), " has the actions 0 to ", manifest.actions_size() - 1));
    }
    if (absl::Status unique = CheckLabel(manifest, action_id, label); !unique.ok()) return unique;
    action->set_label(label);
    evaluation::CompleteActionNames(manifest);
    labelled = *action;
    return artifact::RewriteModelManifest(FolderOf(name), manifest);
  });
  if (!status.ok()) return status;
  return labelled;
}

}  // namespace maneuver::serving
