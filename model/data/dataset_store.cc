#include "model/data/dataset_store.h"

#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_layout.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/files/output_file.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::TimeUtil;

// Left free by every upload, for jobs and their store.
constexpr uint64_t kReservedBytes = uint64_t{64} << 20;
// Datasets whose summaries are kept in memory.
constexpr size_t kMaxSummaries = 16;

absl::Status NoSuchDataset(const std::string& id) {
  return absl::NotFoundError(absl::StrCat("there is no datasets/", id));
}

absl::Status Exists(const std::string& id) {
  return absl::AlreadyExistsError(
      absl::StrCat("datasets/", id,
                   " exists already; datasets never change: choose another name, "
                   "or delete it first"));
}

bool Damaged(const absl::Status& status) { return absl::IsDataLoss(status); }

uint64_t BytesOf(const v1::Dataset& manifest) {
  uint64_t bytes = 0;
  for (const v1::Shard& shard : manifest.shards()) {
    const auto size = static_cast<uint64_t>(std::max<int64_t>(0, shard.size_bytes()));
    bytes += std::min(size, std::numeric_limits<uint64_t>::max() - bytes);
  }
  return bytes;
}

}  // namespace

// Safe to use from any thread.
class Arrivals {
 public:
  struct Bytes {
    uint64_t announced = 0;
    uint64_t missing = 0;  // of these, not on the disk yet
  };

  // Announces so many unless `refuse`, told what others have announced, finds an error.
  absl::Status Announce(uint64_t bytes, const std::function<absl::Status(const Bytes&)>& refuse) {
    const std::lock_guard lock(mutex_);
    if (absl::Status status = refuse(bytes_); !status.ok()) return status;
    bytes_.announced += bytes;
    bytes_.missing += bytes;
    return absl::OkStatus();
  }
  void Arrived(uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    bytes_.missing -= bytes;
  }
  // An upload is over.
  void End(const Bytes& of_upload) {
    const std::lock_guard lock(mutex_);
    bytes_.announced -= of_upload.announced;
    bytes_.missing -= of_upload.missing;
  }

 private:
  std::mutex mutex_;
  Bytes bytes_;  // guarded by mutex_
};

namespace {

class Upload final : public DatasetUpload {
 public:
  // What the manifest says has been announced.
  Upload(std::string id, fs::path folder, fs::path temporary, v1::Dataset manifest,
         std::shared_ptr<Arrivals> arrivals)
      : id_(std::move(id)),
        folder_(std::move(folder)),
        temporary_(std::move(temporary)),
        manifest_(std::move(manifest)),
        arrivals_(std::move(arrivals)),
        bytes_{BytesOf(manifest_), BytesOf(manifest_)} {}

  ~Upload() override {
    file_.reset();
    std::error_code ignored;
    if (!committed_) fs::remove_all(temporary_, ignored);
    arrivals_->End(bytes_);
  }

  absl::Status Append(std::string_view bytes) override {
    if (!status_.ok()) return status_;
    return status_ = Take(bytes);
  }

  absl::StatusOr<v1::Dataset> Commit() override {
    if (!status_.ok()) return status_;
    status_ = CommitOnce();
    if (!status_.ok()) return status_;
    committed_ = true;
    return manifest_;
  }

 private:
  const v1::Shard& shard() const { return manifest_.shards(shard_); }

  absl::Status Take(std::string_view bytes) {
    // Also moves past shards without a byte.
    if (absl::Status status = FinishFullShards(); !status.ok()) return status;
    while (!bytes.empty()) {
      if (shard_ == manifest_.shards_size()) {
        return absl::InvalidArgumentError(absl::StrCat(
            "more bytes than the header's shards have: ", bytes.size(), " after the end of ",
            shard_ == 0 ? "nothing" : manifest_.shards(shard_ - 1).file()));
      }
      if (file_ == nullptr) {
        auto file = files::OutputFile::Create(temporary_ / shard().file());
        if (!file.ok()) return file.status();
        file_ = *std::move(file);
        digest_ = std::make_unique<files::Sha256>();
      }
      const auto left = static_cast<uint64_t>(shard().size_bytes() - file_->size_bytes());
      const std::string_view part =
          bytes.substr(0, static_cast<size_t>(std::min<uint64_t>(left, bytes.size())));
      digest_->Update(part);
      if (absl::Status status = file_->Append(part); !status.ok()) return status;
      bytes.remove_prefix(part.size());
      arrivals_->Arrived(part.size());
      bytes_.missing -= part.size();
      if (absl::Status status = FinishFullShards(); !status.ok()) return status;
    }
    return absl::OkStatus();
  }

  // Closes the shard that has all its bytes, and those after it that have none.
  absl::Status FinishFullShards() {
    while (shard_ < manifest_.shards_size()) {
      if (file_ == nullptr) {
        if (shard().size_bytes() > 0) return absl::OkStatus();
        auto file = files::OutputFile::Create(temporary_ / shard().file());
        if (!file.ok()) return file.status();
        file_ = *std::move(file);
        digest_ = std::make_unique<files::Sha256>();
      }
      if (file_->size_bytes() < shard().size_bytes()) return absl::OkStatus();
      if (absl::Status status = file_->Close(); !status.ok()) return status;
      file_.reset();
      if (digest_->Finish() != shard().sha256()) {
        return absl::DataLossError(
            absl::StrCat("shard ", shard().file(),
                         " arrived with another SHA-256 than the header says: it was "
                         "altered on its way, or before; upload it again"));
      }
      ++shard_;
    }
    return absl::OkStatus();
  }

  absl::Status CommitOnce() {
    if (absl::Status status = FinishFullShards(); !status.ok()) return status;
    if (shard_ < manifest_.shards_size()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the upload ended within shard ", shard().file(), ": ",
          file_ == nullptr ? 0 : file_->size_bytes(), " of ", shard().size_bytes(), " bytes"));
    }
    manifest_.set_name(absl::StrCat("datasets/", id_));
    *manifest_.mutable_create_time() = TimeUtil::GetCurrentTime();
    absl::Status status = files::WriteFileAtomically(temporary_ / kManifestFile,
                                                     PrintDatasetManifest(manifest_) + "\n");
    if (!status.ok()) return status;
    status = VerifyDatasetFolder(temporary_);
    // The digests agreed: it is not damaged, it never was what it should be.
    if (Damaged(status)) return absl::InvalidArgumentError(status.message());
    if (!status.ok()) return status;
    status = files::PublishFolder(temporary_, folder_);
    return absl::IsAlreadyExists(status) ? Exists(id_) : status;
  }

  const std::string id_;
  const fs::path folder_;
  const fs::path temporary_;
  v1::Dataset manifest_;
  const std::shared_ptr<Arrivals> arrivals_;
  Arrivals::Bytes bytes_;  // of this upload
  int shard_ = 0;          // that is arriving
  std::unique_ptr<files::OutputFile> file_;
  std::unique_ptr<files::Sha256> digest_;
  absl::Status status_;
  bool committed_ = false;
};

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

}  // namespace

DatasetStore::DatasetStore(fs::path folder, int64_t quota_bytes)
    : folder_(std::move(folder)),
      quota_bytes_(quota_bytes),
      arrivals_(std::make_shared<Arrivals>()) {}

absl::StatusOr<std::unique_ptr<DatasetStore>> DatasetStore::Open(fs::path folder,
                                                                 int64_t quota_bytes) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  if (absl::Status status = files::RemoveTemporaries(folder); !status.ok()) return status;
  return std::unique_ptr<DatasetStore>(new DatasetStore(std::move(folder), quota_bytes));
}

bool DatasetStore::Contains(const std::string& id) const {
  std::error_code error;
  return fs::exists(FolderOf(id) / kManifestFile, error);
}

absl::StatusOr<v1::Dataset> DatasetStore::Get(const std::string& id) const {
  auto manifest = ReadDatasetManifest(FolderOf(id));
  // Also if it was taken away meanwhile.
  if (!manifest.ok() && !Contains(id)) return NoSuchDataset(id);
  if (!manifest.ok()) return manifest.status();
  manifest->set_name(absl::StrCat("datasets/", id));
  return manifest;
}

absl::StatusOr<std::vector<std::string>> DatasetStore::List(const std::string& after,
                                                            size_t limit) const {
  std::vector<std::string> ids;
  std::error_code error;
  fs::directory_iterator entry(folder_, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::string name = entry->path().filename().string();
    if (name.front() != '.' && name > after && Contains(name)) ids.push_back(std::move(name));
  }
  if (error) return files::ErrnoStatus(error.value(), "read", folder_);
  std::ranges::sort(ids);
  if (ids.size() > limit) ids.resize(limit);
  return ids;
}

absl::StatusOr<std::unique_ptr<DatasetUpload>> DatasetStore::BeginUpload(
    const std::string& id, const v1::Dataset& manifest) const {
  std::error_code error;
  if (fs::exists(FolderOf(id), error)) return Exists(id);
  const uint64_t wanted = BytesOf(manifest);
  const absl::Status room = arrivals_->Announce(wanted, [&](const Arrivals::Bytes& others) {
    // An upload that ends meanwhile counts twice rather than not at all.
    const auto total = quota_bytes_ > 0 ? TotalBytes() : 0;
    if (!total.ok()) return total.status();
    const auto quota = static_cast<uint64_t>(quota_bytes_);
    const uint64_t kept = static_cast<uint64_t>(*total) + others.announced;
    if (quota > 0 && (kept > quota || wanted > quota - kept)) {
      return absl::FailedPreconditionError(absl::StrCat(
          "the dataset has ", wanted, " bytes and of the ", quota,
          " that all datasets may have together ", kept > quota ? 0 : quota - kept,
          " are left; delete datasets that are no longer needed, or start the server with a larger "
          "--dataset-quota"));
    }
    const fs::space_info space = fs::space(folder_, error);
    const uint64_t taken = kReservedBytes + others.missing;
    if (!error && (space.available < taken || wanted > space.available - taken)) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the dataset needs ", wanted, " bytes and the server has ",
                       space.available < taken ? 0 : space.available - taken,
                       " left; delete datasets or models that are no longer needed"));
    }
    return absl::OkStatus();
  });
  if (!room.ok()) return room;
  auto temporary = files::MakeTemporaryFolderFor(FolderOf(id));
  if (!temporary.ok()) {
    arrivals_->End({wanted, wanted});
    return temporary.status();
  }
  return std::make_unique<Upload>(id, FolderOf(id), *std::move(temporary), manifest, arrivals_);
}

absl::StatusOr<int64_t> DatasetStore::TotalBytes() const {
  const auto ids = List("", std::numeric_limits<size_t>::max());
  if (!ids.ok()) return ids.status();
  int64_t bytes = 0;
  for (const std::string& id : *ids) {
    // One that was deleted meanwhile, or cannot be read, takes no part.
    if (const auto dataset = Get(id); dataset.ok()) {
      bytes += static_cast<int64_t>(BytesOf(*dataset));
    }
  }
  return bytes;
}

absl::StatusOr<fs::path> DatasetStore::Detach(const std::string& id) {
  // An empty folder of a name that the next Open removes; the dataset takes its place.
  auto temporary = files::MakeTemporaryFolderFor(FolderOf(id));
  if (!temporary.ok()) return temporary.status();
  std::error_code error;
  fs::rename(FolderOf(id), *temporary, error);
  if (error) {
    std::error_code ignored;
    fs::remove(*temporary, ignored);
    if (error == std::errc::no_such_file_or_directory) return NoSuchDataset(id);
    return files::ErrnoStatus(error.value(), "delete", FolderOf(id));
  }
  if (absl::Status status = files::SyncPath(folder_); !status.ok()) return status;
  const std::lock_guard lock(mutex_);
  std::erase_if(summaries_, [&](const auto& entry) { return entry.first.first == id; });
  return *temporary;
}

absl::StatusOr<DatasetStore::Summaries> DatasetStore::SummariesOf(const std::string& id) {
  const auto manifest = Get(id);
  if (!manifest.ok()) return manifest.status();
  const std::pair key(id, TimeUtil::TimestampToNanoseconds(manifest->create_time()));
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = summaries_.find(key); found != summaries_.end()) return found->second;
  }
  auto summaries = std::make_shared<std::vector<v1::ScenarioSummary>>();
  const absl::Status status =
      ForEachScenario(FolderOf(id), OnDamage::kStop, [&](v1::Scenario&& scenario) {
        summaries->push_back(Summarize(scenario));
        return true;
      });
  if (!status.ok()) return Contains(id) ? status : NoSuchDataset(id);
  const std::lock_guard lock(mutex_);
  if (summaries_.size() >= kMaxSummaries) summaries_.erase(summaries_.begin());
  summaries_[key] = summaries;
  return summaries;
}

absl::StatusOr<std::vector<v1::ScenarioSummary>> DatasetStore::ListScenarios(const std::string& id,
                                                                             size_t begin,
                                                                             size_t limit) {
  const auto summaries = SummariesOf(id);
  if (!summaries.ok()) return summaries.status();
  const std::vector<v1::ScenarioSummary>& all = **summaries;
  begin = std::min(begin, all.size());
  const size_t end = begin + std::min(limit, all.size() - begin);
  return std::vector<v1::ScenarioSummary>(all.begin() + static_cast<std::ptrdiff_t>(begin),
                                          all.begin() + static_cast<std::ptrdiff_t>(end));
}

absl::StatusOr<v1::DatasetSummary> DatasetStore::Describe(
    const std::string& id, const v1::ModelSpec& spec, const v1::ExampleSettings& settings) const {
  if (!Contains(id)) return NoSuchDataset(id);
  auto summary = DescribeDataset(FolderOf(id), spec, settings);
  if (!summary.ok() && !Contains(id)) return NoSuchDataset(id);
  if (summary.ok()) summary->mutable_dataset()->set_name(absl::StrCat("datasets/", id));
  return summary;
}

absl::StatusOr<v1::Scenario> DatasetStore::GetScenario(const std::string& id,
                                                       const std::string& scenario_id) const {
  if (!Contains(id)) return NoSuchDataset(id);
  auto scenario = ReadScenario(FolderOf(id), scenario_id);
  if (!scenario.ok() && !Contains(id)) return NoSuchDataset(id);
  return scenario;
}

}  // namespace maneuver::data
