// An upload as it comes, into its slot; for the .cc files of this folder alone.

#ifndef MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_
#define MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/dataset.pb.h"
#include "model/data/dataset_store.h"
#include "model/data/upload_staging.h"

namespace maneuver::data {

// datasets/{id} exists.
absl::Status DatasetExists(const std::string& id);

struct StagedUploadStart {
  std::string id;
  std::filesystem::path folder;  // that it becomes
  v1::Dataset manifest;
  std::vector<int64_t> arrived;  // [shards] bytes that are there and are not sent
  std::shared_ptr<UploadStaging::Slot> slot;
  int64_t turn = 0;  // with which what is sent was announced
};

// From there on.
std::unique_ptr<DatasetUpload> ContinueUpload(StagedUploadStart start,
                                              std::shared_ptr<UploadStaging> staging);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_
