// Turns an upload into a dataset. Private to this folder's .cc files.

#ifndef MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_
#define MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/dataset.pb.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_upload.h"
#include "model/files/file_receiver.h"

namespace maneuver::data {

// Returns ALREADY_EXISTS: datasets/{id} exists.
absl::Status DatasetExists(const std::string& id);

// Returns the shards of a manifest as files to receive.
std::vector<files::AnnouncedFile> ShardFiles(const v1::Dataset& manifest);

// Makes a temporary folder with all shards a dataset: completes and writes its manifest, verifies
// everything, indexes each shard, and publishes the folder.
//   INVALID_ARGUMENT: the files differ from the manifest, or a record is not valid.
//   ALREADY_EXISTS: another upload of this id was completed first.
absl::Status FinishDataset(const std::string& id, const std::filesystem::path& temporary,
                           const PublishDataset& publish, v1::Dataset* manifest);

// Returns an upload that becomes the dataset `id` in `folder`.
//   shards: receives the shards of `manifest`.
std::unique_ptr<DatasetUpload> StageDataset(std::string id, std::filesystem::path folder,
                                            PublishDataset publish, v1::Dataset manifest,
                                            std::unique_ptr<files::FileReceiver> shards);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_
