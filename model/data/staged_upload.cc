#include "model/data/staged_upload.h"

#include <google/protobuf/util/time_util.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_manifest.h"
#include "model/data/recording_index.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::TimeUtil;

class StagedUpload final : public DatasetUpload {
 public:
  StagedUpload(std::string id, fs::path folder, PublishDataset publish, v1::Dataset manifest,
               std::unique_ptr<files::FileReceiver> shards)
      : id_(std::move(id)),
        folder_(std::move(folder)),
        publish_(std::move(publish)),
        manifest_(std::move(manifest)),
        shards_(std::move(shards)) {}

  absl::Status Append(std::string_view bytes) override { return shards_->Append(bytes); }

  absl::StatusOr<v1::Dataset> Commit() override {
    const absl::Status status = shards_->Commit(folder_, [this](const fs::path& temporary) {
      return FinishDataset(id_, temporary, publish_, &manifest_);
    });
    if (!status.ok()) return status;
    return manifest_;
  }

  void Discard() override { shards_->Discard(); }

 private:
  const std::string id_;
  const fs::path folder_;
  const PublishDataset publish_;
  v1::Dataset manifest_;
  const std::unique_ptr<files::FileReceiver> shards_;
};

}  // namespace

absl::Status DatasetExists(const std::string& id) {
  return absl::AlreadyExistsError(
      absl::StrCat("datasets/", id,
                   " exists already; datasets never change: choose another name, "
                   "or delete it first"));
}

std::vector<files::AnnouncedFile> ShardFiles(const v1::Dataset& manifest) {
  std::vector<files::AnnouncedFile> announced;
  for (const v1::Shard& shard : manifest.shards()) {
    announced.push_back({shard.file(), shard.size_bytes(), shard.sha256()});
  }
  return announced;
}

absl::Status FinishDataset(const std::string& id, const fs::path& temporary,
                           const PublishDataset& publish, v1::Dataset* manifest) {
  manifest->set_name(absl::StrCat("datasets/", id));
  *manifest->mutable_create_time() = TimeUtil::GetCurrentTime();
  absl::Status status = WriteDatasetManifest(temporary, *manifest);
  if (!status.ok()) return status;
  status = VerifyDatasetFolder(temporary);
  // An upload's digests agreed: it is not damaged, it never was what it should be.
  if (absl::IsDataLoss(status)) return absl::InvalidArgumentError(status.message());
  if (!status.ok()) return status;
  status = RecordingIndex::Open(temporary).status();  // indexes each shard
  if (!status.ok()) return status;
  status = publish(temporary, *manifest);
  return absl::IsAlreadyExists(status) ? DatasetExists(id) : status;
}

std::unique_ptr<DatasetUpload> StageDataset(std::string id, fs::path folder, PublishDataset publish,
                                            v1::Dataset manifest,
                                            std::unique_ptr<files::FileReceiver> shards) {
  return std::make_unique<StagedUpload>(std::move(id), std::move(folder), std::move(publish),
                                        std::move(manifest), std::move(shards));
}

}  // namespace maneuver::data
