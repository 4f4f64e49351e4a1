#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <string_view>
#include <system_error>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_manifest.h"
#include "model/data/shard_index.h"
#include "model/data/tfrecord.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::data {
namespace {

// Returns the time from the first to the last state of any agent, seconds.
double Duration(const v1::Scenario& scenario) {
  double first = std::numeric_limits<double>::infinity();
  double last = -first;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.states().empty()) continue;
    first = std::min(first, agent.states().begin()->time());
    last = std::max(last, agent.states().rbegin()->time());
  }
  return last > first ? last - first : 0.0;
}

// The shards of one content: "<stem>-00000.tfrecord", ...
class ShardSeries {
 public:
  ShardSeries(std::filesystem::path folder, std::string stem, v1::ShardContent content,
              int64_t shard_bytes)
      : folder_(std::move(folder)),
        stem_(std::move(stem)),
        content_(content),
        shard_bytes_(shard_bytes) {}

  //   scenario_id: of a scenario, for the index of its shard
  absl::Status Append(const std::string& payload, std::string_view scenario_id) {
    if (writer_ != nullptr && writer_->size_bytes() >= shard_bytes_) {
      if (absl::Status status = Close(); !status.ok()) return status;
    }
    if (writer_ == nullptr) {
      char number[16];
      std::snprintf(number, sizeof number, "%05zu", shards_.size());
      file_ = absl::StrCat(stem_, "-", number, ".tfrecord");
      auto writer = TfRecordWriter::Create(folder_ / file_);
      if (!writer.ok()) return writer.status();
      writer_ = *std::move(writer);
    }
    if (content_ == v1::SHARD_CONTENT_SCENARIOS) {
      AddToIndex(scenario_id, static_cast<uint64_t>(writer_->size_bytes()), payload, &index_);
    }
    return writer_->Append(payload);
  }

  absl::Status Close() {
    if (writer_ == nullptr) return absl::OkStatus();
    if (absl::Status status = writer_->Close(); !status.ok()) return status;
    v1::Shard shard;
    shard.set_file(file_);
    shard.set_content(content_);
    shard.set_size_bytes(writer_->size_bytes());
    shard.set_records(writer_->records());
    shard.set_sha256(writer_->sha256());
    shards_.push_back(std::move(shard));
    writer_.reset();
    if (content_ != v1::SHARD_CONTENT_SCENARIOS) return absl::OkStatus();
    return WriteShardIndex(folder_, shards_.back(), std::exchange(index_, {}));
  }

  const std::vector<v1::Shard>& shards() const { return shards_; }

 private:
  const std::filesystem::path folder_;
  const std::string stem_;
  const v1::ShardContent content_;
  const int64_t shard_bytes_;
  std::string file_;
  std::unique_ptr<TfRecordWriter> writer_;
  ShardIndex index_;  // of the shard that is being written
  std::vector<v1::Shard> shards_;
};

class FolderWriter final : public DatasetWriter {
 public:
  FolderWriter(std::filesystem::path folder, std::filesystem::path temporary, std::string origin,
               const DatasetWriterOptions& options)
      : folder_(std::move(folder)),
        temporary_(std::move(temporary)),
        publish_(options.publish),
        scenarios_(temporary_, "scenarios", v1::SHARD_CONTENT_SCENARIOS, options.shard_bytes),
        annotations_(temporary_, "annotations", v1::SHARD_CONTENT_ANNOTATIONS,
                     options.shard_bytes) {
    manifest_.set_format_version(kDatasetFormatVersion);
    manifest_.set_origin(std::move(origin));
  }

  ~FolderWriter() override {
    std::error_code ignored;
    if (!committed_) std::filesystem::remove_all(temporary_, ignored);
  }

  absl::Status Add(const v1::Scenario& scenario) override {
    const std::string& id = scenario.scenario_id();
    if (id.empty()) return absl::InvalidArgumentError("a recording needs a scenario_id");
    const auto violations = scene::ValidateScenario(scenario, {});
    if (!violations.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "scenario ", id, ": ", violations.front().field, " ", violations.front().description));
    }
    if (ids_.contains(id)) {
      return absl::AlreadyExistsError(absl::StrCat("scenario ", id, " was added before"));
    }
    if (absl::Status status = Append(scenario, id, &scenarios_); !status.ok()) return status;
    ids_.insert(id);
    manifest_.set_recordings(manifest_.recordings() + 1);
    manifest_.set_duration_seconds(manifest_.duration_seconds() + Duration(scenario));
    return absl::OkStatus();
  }

  absl::Status Add(const v1::ManeuverAnnotation& annotation) override {
    if (annotation.scenario_id().empty()) {
      return absl::InvalidArgumentError("an annotation must name its scenario");
    }
    return Append(annotation, annotation.scenario_id(), &annotations_);
  }

  absl::StatusOr<v1::Dataset> Commit() override {
    if (!failed_.ok()) return failed_;
    if (manifest_.recordings() == 0) {
      return absl::FailedPreconditionError("a dataset needs at least one recording");
    }
    for (ShardSeries* series : {&scenarios_, &annotations_}) {
      if (failed_ = series->Close(); !failed_.ok()) return failed_;
      manifest_.mutable_shards()->Add(series->shards().begin(), series->shards().end());
    }
    *manifest_.mutable_create_time() = google::protobuf::util::TimeUtil::GetCurrentTime();
    if (const auto violations = ValidateDatasetManifest(manifest_); !violations.empty()) {
      failed_ = absl::InvalidArgumentError(
          absl::StrCat(violations.front().field, " ", violations.front().description));
      return failed_;
    }
    failed_ = WriteDatasetManifest(temporary_, manifest_);
    if (failed_.ok()) {
      failed_ =
          publish_ ? publish_(temporary_, manifest_) : files::PublishFolder(temporary_, folder_);
    }
    if (!failed_.ok()) return failed_;
    committed_ = true;
    return manifest_;
  }

 private:
  // A failed write leaves half a record, so nothing can be appended after it.
  absl::Status Append(const google::protobuf::Message& message, std::string_view scenario_id,
                      ShardSeries* series) {
    if (!failed_.ok()) return failed_;
    if (!message.SerializeToString(&payload_)) {
      return absl::InvalidArgumentError("a record must be smaller than 2 GiB and valid UTF-8");
    }
    failed_ = series->Append(payload_, scenario_id);
    return failed_;
  }

  const std::filesystem::path folder_;
  const std::filesystem::path temporary_;
  const PublishDataset publish_;
  ShardSeries scenarios_;
  ShardSeries annotations_;
  v1::Dataset manifest_;
  std::unordered_set<std::string> ids_;
  std::string payload_;
  absl::Status failed_;
  bool committed_ = false;
};

}  // namespace

absl::StatusOr<std::unique_ptr<DatasetWriter>> DatasetWriter::Create(
    const std::filesystem::path& folder, std::string origin, const DatasetWriterOptions& options) {
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::symlink_status(folder, error))) {
    return absl::AlreadyExistsError(
        absl::StrCat("cannot create ", files::NameOf(folder), ": it exists already"));
  }
  auto temporary = files::MakeTemporaryFolderFor(folder);
  if (!temporary.ok()) return temporary.status();
  return std::make_unique<FolderWriter>(folder, *std::move(temporary), std::move(origin), options);
}

}  // namespace maneuver::data
