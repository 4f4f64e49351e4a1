#include "model/data/dataset_store.h"

#include <algorithm>
#include <cerrno>
#include <limits>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_manifest.h"
#include "model/data/registered_folder.h"
#include "model/data/staged_upload.h"
#include "model/files/abandoned_temporaries.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/files/file_receiver.h"
#include "model/files/file_system_failure.h"
#include "model/machine/usable_cores.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;

// Every upload leaves this much free for jobs and their store.
constexpr uint64_t kReservedBytes = uint64_t{64} << 20;
// Recordings whose places are kept in memory, of all datasets together.
constexpr size_t kMostIndexed = 1'000'000;

absl::Status NoSuchDataset(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no datasets/", id));
}

bool SameShards(const v1::Dataset& a, const v1::Dataset& b) {
  return std::ranges::equal(
      a.shards(), b.shards(), [](const v1::Shard& left, const v1::Shard& right) {
        return left.file() == right.file() && left.content() == right.content() &&
               left.size_bytes() == right.size_bytes() && left.records() == right.records() &&
               left.sha256() == right.sha256();
      });
}

v1::ScenarioSummary Summarize(const v1::Scenario& scenario) {
  v1::ScenarioSummary summary;
  summary.set_scenario_id(scenario.scenario_id());
  double start = std::numeric_limits<double>::infinity();
  double end = -start;
  int vehicles = 0;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.type() == v1::AGENT_TYPE_VEHICLE) ++vehicles;
    if (agent.states().empty()) continue;
    start = std::min(start, agent.states().begin()->time());
    end = std::max(end, agent.states().rbegin()->time());
  }
  int points = 0;
  for (const v1::MapFeature& feature : scenario.map_features()) points += feature.x_size();
  if (start <= end) {
    summary.set_start_time(start);
    summary.set_end_time(end);
  }
  summary.set_agents(scenario.agents_size());
  summary.set_vehicles(vehicles);
  summary.set_map_points(points);
  *summary.mutable_target_ids() = scenario.target_ids();
  return summary;
}

std::string IdOf(const v1::Dataset& dataset) {
  return std::string(absl::StripPrefix(dataset.name(), "datasets/"));
}

// Reads the manifest of a folder, with the name that the ledger wants.
absl::StatusOr<v1::Dataset> ReadNamed(const fs::path& folder) {
  auto manifest = LoadDatasetManifest(folder);
  if (manifest.ok()) manifest->set_name(absl::StrCat("datasets/", folder.filename().string()));
  return manifest;
}

// Returns what the shards of a dataset take in its folder.
int64_t BytesIn(const fs::path& folder, const v1::Dataset& manifest) {
  if (IsRegistered(folder)) return 0;
  constexpr uint64_t kMost = std::numeric_limits<int64_t>::max();
  return static_cast<int64_t>(std::min(files::BytesOf(ShardFiles(manifest)), kMost));
}

// Publishes the dataset of a folder: with a ledger, one of several that are made at once.
PublishDataset Publisher(const fs::path& folder, DatasetLedger* ledger) {
  return [folder, ledger](const fs::path& temporary, v1::Dataset manifest) {
    if (ledger == nullptr) return files::PublishFolder(temporary, folder);
    // What takes long comes first.
    if (absl::Status status = files::SyncFolder(temporary); !status.ok()) return status;
    manifest.set_name(absl::StrCat("datasets/", folder.filename().string()));
    return ledger->Add(manifest, BytesIn(temporary, manifest),
                       [&] { return files::MoveIntoPlace(temporary, folder); });
  };
}

// What Dataset.origin says of a folder that is registered.
std::string OriginOf(const v1::Dataset& manifest, const fs::path& source) {
  std::string origin = absl::StrCat("in place: ", source.string());
  if (!manifest.origin().empty()) absl::StrAppend(&origin, " (", manifest.origin(), ")");
  return origin.size() <= kMaxOrigin ? origin : manifest.origin();
}

// Prefix of the file that keeps a description; a digest of its settings follows.
constexpr char kDescriptionPrefix[] = ".description-";
// Increment it when what is counted, or how, changes.
constexpr int kDescriptionVersion = 3;

std::string DescriptionFile(const v1::ModelSpec& spec, const v1::ExampleSettings& settings) {
  const std::string digest = files::Sha256Hex(absl::StrCat(
      kDescriptionVersion, "\n", spec.SerializeAsString(), "\n", settings.SerializeAsString()));
  return absl::StrCat(kDescriptionPrefix, digest.substr(0, 16));
}

// Replaces any earlier description. If writing fails, the next call counts again.
void KeepDescription(const fs::path& file, const v1::DatasetSummary& summary) {
  std::error_code error;
  std::vector<fs::path> others;
  for (fs::directory_iterator entry(file.parent_path(), error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().filename().string().starts_with(kDescriptionPrefix)) {
      others.push_back(entry->path());
    }
  }
  for (const fs::path& other : others) fs::remove(other, error);
  const std::string message = summary.SerializeAsString();
  (void)files::WriteFileAtomically(file, files::Sha256Hex(message) + message);
}

// Returns a kept description; nothing if there is none, or it is damaged.
std::optional<v1::DatasetSummary> KeptDescription(const fs::path& file) {
  constexpr size_t kDigits = 64;  // of the SHA-256, which comes first
  const auto content = files::ReadFile(file);
  if (!content.ok() || content->size() < kDigits) return std::nullopt;
  const std::string message = content->substr(kDigits);
  v1::DatasetSummary summary;
  if (files::Sha256Hex(message) != content->substr(0, kDigits) ||
      !summary.ParseFromString(message)) {
    return std::nullopt;
  }
  return summary;
}

}  // namespace

DatasetStore::DatasetStore(fs::path folder, const DatasetStoreOptions& options,
                           DatasetLedger* ledger)
    : folder_(std::move(folder)),
      options_(options),
      ledger_(ledger),
      staging_(std::make_shared<files::UploadStaging>(folder_, options.is_shared)),
      indexes_(kMostIndexed) {}

absl::StatusOr<std::unique_ptr<DatasetStore>> DatasetStore::Open(fs::path folder,
                                                                 const DatasetStoreOptions& options,
                                                                 DatasetLedger* ledger) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  if (options.is_shared) {
    files::RemoveAbandonedTemporaries(folder, fs::file_time_type::clock::now());
  } else if (absl::Status status = files::RemoveTemporaries(folder); !status.ok()) {
    return status;
  }
  std::unique_ptr<DatasetStore> store(new DatasetStore(std::move(folder), options, ledger));
  if (absl::Status status = store->AdoptFolders(); !status.ok()) return status;
  // The process may have died right after a commit, with the upload's shards still there.
  absl::Status status = store->staging_->RemoveIf(
      [&](const std::string& id, fs::file_time_type) { return store->Contains(id); });
  status.Update(store->RemoveAbandonedUploads(fs::file_time_type::clock::now()));
  if (!status.ok()) return status;
  return store;
}

absl::Status DatasetStore::CheckFolder(const std::string& id) const {
  std::error_code error;
  const bool exists = fs::exists(FolderOf(id) / kManifestFile, error);
  // It may be there all the same.
  if (error) return files::ErrnoStatus(error.value(), "read", FolderOf(id));
  return exists ? absl::OkStatus() : NoSuchDataset(id);
}

absl::Status DatasetStore::CheckExists(const std::string& id) const {
  absl::Status there = CheckFolder(id);
  if (ledger_ == nullptr || files::IsFileSystemFailure(there)) return there;
  if (const auto listed = Get(id); !listed.ok()) return listed.status();
  if (!absl::IsNotFound(there)) return there;
  return absl::DataLossError(absl::StrCat("the folder of datasets/", id,
                                          " is gone; have the operator restore it, or delete the "
                                          "dataset and upload it again"));
}

absl::Status DatasetStore::CheckAbsent(const std::string& id) const {
  if (ledger_ != nullptr) {
    const absl::Status listed = Get(id).status();
    if (!listed.ok() && !absl::IsNotFound(listed)) return listed;
    if (listed.ok()) return DatasetExists(id);
  }
  std::error_code error;
  return fs::exists(FolderOf(id), error) ? DatasetExists(id) : absl::OkStatus();
}

absl::Status DatasetStore::WhyUnread(const std::string& id, absl::Status status) const {
  absl::Status exists = CheckExists(id);
  return exists.ok() ? status : exists;
}

absl::StatusOr<v1::Dataset> DatasetStore::Read(const std::string& id) const {
  auto manifest = ReadDatasetManifest(FolderOf(id));
  if (!manifest.ok()) return WhyUnread(id, manifest.status());
  manifest->set_name(absl::StrCat("datasets/", id));
  return manifest;
}

absl::StatusOr<v1::Dataset> DatasetStore::Get(const std::string& id) const {
  if (ledger_ == nullptr) return Read(id);
  auto listed = ledger_->Get(id);
  if (!absl::IsNotFound(listed.status())) return listed;
  if (absl::Status status = AdoptFolder(id); !status.ok()) return status;
  return ledger_->Get(id);
}

absl::StatusOr<std::vector<std::string>> DatasetStore::FolderNames() const {
  const auto entries = files::ListFolder(folder_);
  if (!entries.ok()) return entries.status();
  std::vector<std::string> names;
  for (const fs::path& entry : *entries) {
    std::string name = entry.filename().string();
    if (name.front() != '.') names.push_back(std::move(name));
  }
  return names;
}

absl::StatusOr<std::vector<v1::Dataset>> DatasetStore::List(const std::string& after,
                                                            size_t limit) const {
  if (ledger_ != nullptr) return ledger_->List(after, limit);
  const auto names = FolderNames();
  if (!names.ok()) return names.status();
  std::vector<v1::Dataset> datasets;
  for (auto name = std::ranges::upper_bound(*names, after);
       name != names->end() && datasets.size() < limit; ++name) {
    auto dataset = Read(*name);
    if (absl::IsNotFound(dataset.status())) continue;  // no dataset, or deleted meanwhile
    if (!dataset.ok()) {
      const absl::Status there = CheckFolder(*name);
      if (files::IsFileSystemFailure(there)) return there;
      dataset = v1::Dataset();
      dataset->set_name(absl::StrCat("datasets/", *name));
    }
    datasets.push_back(*std::move(dataset));
  }
  return datasets;
}

absl::Status DatasetStore::AdoptFolder(const std::string& id) const {
  const auto manifest = ReadNamed(FolderOf(id));
  if (!manifest.ok()) {
    const absl::Status there = CheckFolder(id);
    return there.ok() ? manifest.status() : there;
  }
  absl::Status status =
      ledger_->Add(*manifest, BytesIn(FolderOf(id), *manifest), [&]() -> absl::Status {
        // Another server may just have deleted it, or even published another one.
        const auto now = ReadNamed(FolderOf(id));
        if (!now.ok()) return now.status();
        return now->SerializeAsString() == manifest->SerializeAsString() ? absl::OkStatus()
                                                                         : NoSuchDataset(id);
      });
  return absl::IsAlreadyExists(status) ? absl::OkStatus() : status;
}

absl::Status DatasetStore::AdoptFolders() const {
  if (ledger_ == nullptr) return absl::OkStatus();
  const auto names = FolderNames();
  if (!names.ok()) return names.status();
  const auto listed = ledger_->ListIds();
  if (!listed.ok()) return listed.status();
  for (const std::string& name : *names) {
    if (std::ranges::binary_search(*listed, name)) continue;
    const absl::Status status = AdoptFolder(name);
    // Not a dataset, deleted meanwhile, or not named like one.
    if (absl::IsNotFound(status) || absl::IsInvalidArgument(status)) continue;
    if (absl::IsDataLoss(status) && !files::IsFileSystemFailure(status)) continue;
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status DatasetStore::AdoptNewFolders() {
  if (ledger_ == nullptr) return absl::OkStatus();
  std::error_code error;
  const fs::file_time_type changed = fs::last_write_time(folder_, error);
  if (error) return files::ErrnoStatus(error.value(), "read", folder_);
  {
    const MutexLock lock(mutex_);
    if (changed == adopted_) return absl::OkStatus();
  }
  if (absl::Status status = AdoptFolders(); !status.ok()) return status;
  const MutexLock lock(mutex_);
  adopted_ = changed;
  return absl::OkStatus();
}

absl::Status DatasetStore::CheckRoom(uint64_t wanted, uint64_t arrived, uint64_t announced,
                                     uint64_t missing, uint64_t broken_off) const {
  // An upload that ends meanwhile must count twice rather than not at all.
  const auto total = options_.quota_bytes > 0 ? TotalBytes() : 0;
  if (!total.ok()) return total.status();
  const auto quota = static_cast<uint64_t>(options_.quota_bytes);
  const uint64_t kept = static_cast<uint64_t>(*total) + announced + broken_off;
  if (quota > 0 && (kept > quota || wanted > quota - kept)) {
    return absl::FailedPreconditionError(absl::StrCat(
        "the dataset has ", wanted, " bytes and of the ", quota,
        " that all datasets may have together ", kept > quota ? 0 : quota - kept, " are left",
        broken_off > 0 ? absl::StrCat(" (interrupted uploads hold ", broken_off, ")") : "",
        "; delete datasets that are no longer needed, or start the server with a larger "
        "--dataset-quota"));
  }
  std::error_code error;
  const fs::space_info space = fs::space(folder_, error);
  const uint64_t taken = kReservedBytes + missing;
  const uint64_t needed = wanted - std::min(arrived, wanted);
  if (!error && (space.available < taken || needed > space.available - taken)) {
    return absl::ResourceExhaustedError(absl::StrCat(
        "the dataset needs ", needed, " bytes and the server has ",
        space.available < taken ? 0 : space.available - taken, " left (", kReservedBytes >> 20,
        " MiB stay free); delete datasets or models that are no longer needed"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<DatasetUpload>> DatasetStore::BeginUpload(
    const std::string& id, const v1::Dataset& manifest, const std::string& caller,
    std::vector<int64_t> arrived) const {
  if (absl::Status status = CheckAbsent(id); !status.ok()) return status;
  auto shards = files::FileReceiver::Begin(
      staging_,
      {.id = id,
       .resource = absl::StrCat("datasets/", id),
       .noun = "shard",
       .caller = caller,
       .files = ShardFiles(manifest),
       .arrived = std::move(arrived)},
      [this](uint64_t wanted, uint64_t there, const files::UploadStaging::Others& others) {
        return CheckRoom(wanted, there, others.under_way.announced, others.under_way.missing,
                         others.broken_off);
      });
  if (!shards.ok()) return shards.status();
  return StageDataset(id, FolderOf(id), Publisher(FolderOf(id), ledger_), manifest,
                      *std::move(shards));
}

absl::StatusOr<std::unique_ptr<DatasetWriter>> DatasetStore::Create(const std::string& id,
                                                                    const std::string& origin,
                                                                    int64_t bytes) const {
  if (absl::Status status = CheckAbsent(id); !status.ok()) return status;
  const auto wanted = static_cast<uint64_t>(bytes);
  const auto slot = staging_->Enter(id, " the server itself");  // no caller's name
  const absl::Status fits =
      staging_->Announce(*slot, {.announced = wanted, .missing = wanted},
                         [&](const files::UploadStaging::Others& others) {
                           return CheckRoom(wanted, 0, others.under_way.announced,
                                            others.under_way.missing, others.broken_off);
                         });
  staging_->End(*slot);
  if (!fits.ok()) return fits;
  return DatasetWriter::Create(FolderOf(id), origin, {.publish = Publisher(FolderOf(id), ledger_)});
}

absl::StatusOr<v1::QueryUploadResponse> DatasetStore::QueryUpload(const std::string& id,
                                                                  const v1::Dataset& manifest,
                                                                  const std::string& caller) const {
  v1::QueryUploadResponse response;
  auto committed = Get(id);
  if (absl::IsUnavailable(committed.status())) return committed.status();
  if (committed.ok() && SameShards(*committed, manifest)) {
    *response.mutable_committed() = *std::move(committed);
  }
  for (const int64_t bytes :
       files::ArrivedBytes(staging_->Enter(id, caller)->folder, ShardFiles(manifest))) {
    response.add_arrived_bytes(bytes);
  }
  return response;
}

absl::Status DatasetStore::CheckRegistrable(const fs::path& folder) const {
  return ResolveRegistrable(folder, options_.folders).status();
}

absl::StatusOr<v1::Dataset> DatasetStore::Register(const std::string& id,
                                                   const fs::path& folder) const {
  const auto source = ResolveRegistrable(folder, options_.folders);
  if (!source.ok()) return source.status();
  const absl::Status exists = CheckExists(id);
  if (!exists.ok() && !absl::IsNotFound(exists) && ledger_ != nullptr) return exists;
  if (exists.ok()) {
    const auto manifest = LoadDatasetManifest(*source);
    auto there = Get(id);
    if (there.ok() && manifest.ok() && RegisteredFrom(FolderOf(id)) == *source &&
        SameShards(*there, *manifest)) {
      return there;
    }
    return DatasetExists(id);
  }
  const auto temporary = files::MakeTemporaryFolderFor(FolderOf(id));
  if (!temporary.ok()) return temporary.status();
  auto manifest = LinkShards(*source, *temporary);
  absl::Status status = manifest.status();
  if (status.ok()) {
    manifest->set_origin(OriginOf(*manifest, *source));
    status = FinishDataset(id, *temporary, Publisher(FolderOf(id), ledger_), &*manifest);
  }
  if (status.ok()) return manifest;
  std::error_code ignored;
  fs::remove_all(*temporary, ignored);
  return status;
}

absl::Status DatasetStore::RemoveAbandonedUploads(fs::file_time_type now) const {
  if (options_.keep_uploads.count() <= 0) return absl::OkStatus();
  return staging_->RemoveIf([&](const std::string&, fs::file_time_type last) {
    return now - last > options_.keep_uploads;
  });
}

absl::StatusOr<int64_t> DatasetStore::TotalBytes() const {
  if (ledger_ != nullptr) return ledger_->TotalBytes();
  const auto datasets = List("", std::numeric_limits<size_t>::max());
  if (!datasets.ok()) return datasets.status();
  int64_t bytes = 0;
  for (const v1::Dataset& dataset : *datasets) {
    bytes += BytesIn(FolderOf(IdOf(dataset)), dataset);  // one that cannot be read has none
  }
  return bytes;
}

absl::StatusOr<fs::path> DatasetStore::MoveOut(const std::string& id) const {
  auto aside = files::MoveAside(FolderOf(id));
  if (!absl::IsNotFound(aside.status())) return aside;
  // While the folder of all datasets is away, none of them is gone.
  std::error_code ignored;
  if (!fs::exists(folder_, ignored)) return files::ErrnoStatus(ENODEV, "delete", FolderOf(id));
  return NoSuchDataset(id);
}

absl::StatusOr<fs::path> DatasetStore::Unlist(const std::string& id) const {
  const absl::Status listed = Get(id).status();  // adopts a folder that nobody has adopted yet
  absl::StatusOr<fs::path> aside = fs::path();
  const absl::Status status = ledger_->Remove(id, [&] {
    aside = MoveOut(id);
    // An earlier call may have been interrupted here.
    if (absl::IsNotFound(aside.status())) aside = fs::path();
    return aside.status();
  });
  // A damaged manifest cannot be listed.
  if (absl::IsDataLoss(listed) && absl::IsNotFound(status)) return MoveOut(id);
  if (!status.ok()) return status;
  return aside;
}

absl::StatusOr<fs::path> DatasetStore::Detach(const std::string& id) {
  auto aside = ledger_ == nullptr ? MoveOut(id) : Unlist(id);
  if (aside.ok()) indexes_.Forget(FolderOf(id));
  return aside;
}

absl::StatusOr<std::shared_ptr<const OpenedIndex>> DatasetStore::IndexOf(
    const std::string& id) const {
  const auto manifest = Read(id);
  if (!manifest.ok()) return manifest.status();
  auto index = indexes_.Open(FolderOf(id), *manifest);
  if (!index.ok()) return WhyUnread(id, index.status());
  return index;
}

absl::StatusOr<std::vector<v1::ScenarioSummary>> DatasetStore::ListScenarios(const std::string& id,
                                                                             size_t begin,
                                                                             size_t limit) const {
  const auto index = IndexOf(id);
  if (!index.ok()) return index.status();
  const RecordingIndex& recordings = (*index)->recordings;
  begin = std::min(begin, recordings.entries().size());
  const size_t end = begin + std::min(limit, recordings.entries().size() - begin);
  std::vector<v1::ScenarioSummary> summaries;
  for (size_t i = begin; i < end; ++i) {
    const absl::StatusOr<v1::Scenario> recording = recordings.Read(i);
    if (!recording.ok()) return WhyUnread(id, recording.status());
    summaries.push_back(Summarize(*recording));
  }
  return summaries;
}

absl::StatusOr<v1::DatasetSummary> DatasetStore::Describe(
    const std::string& id, const v1::ModelSpec& spec, const v1::ExampleSettings& settings,
    const std::function<bool()>& gives_up) const {
  const auto manifest = Read(id);
  if (!manifest.ok()) return manifest.status();
  const fs::path kept = FolderOf(id) / DescriptionFile(spec, settings);
  std::optional<v1::DatasetSummary> summary = KeptDescription(kept);
  if (!summary) {
    const int threads = std::clamp(machine::UsableCores() / 4, 1, 4);
    auto counted = DescribeDataset(FolderOf(id), spec, settings, threads, gives_up);
    if (absl::IsCancelled(counted.status())) return counted;
    if (!counted.ok()) return WhyUnread(id, counted.status());
    summary = *std::move(counted);
    KeepDescription(kept, *summary);
  }
  *summary->mutable_dataset() = *manifest;
  return *std::move(summary);
}

absl::StatusOr<v1::Scenario> DatasetStore::GetScenario(const std::string& id,
                                                       const std::string& scenario_id) const {
  const auto index = IndexOf(id);
  if (!index.ok()) return index.status();
  const auto found = (*index)->numbers.find(scenario_id);
  if (found == (*index)->numbers.end()) {
    return absl::NotFoundError(absl::StrCat("the dataset has no scenario ", scenario_id));
  }
  auto scenario = (*index)->recordings.Read(found->second);
  if (!scenario.ok()) return WhyUnread(id, scenario.status());
  return scenario;
}

}  // namespace maneuver::data
