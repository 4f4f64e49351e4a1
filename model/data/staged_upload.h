// Receives an upload into its slot. Private to this folder's .cc files.

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

// Returns ALREADY_EXISTS: datasets/{id} exists.
absl::Status DatasetExists(const std::string& id);

struct StagedUploadStart {
  std::string id;
  std::filesystem::path folder;  // of the future dataset
  v1::Dataset manifest;
  std::vector<int64_t> arrived;  // [shards] bytes that are not sent, because they have arrived
  std::shared_ptr<UploadStaging::Slot> slot;
  int64_t turn = 0;  // of the slot; this upload's bytes were announced with it
};

// Returns an upload that continues from there.
std::unique_ptr<DatasetUpload> ContinueUpload(StagedUploadStart start,
                                              std::shared_ptr<UploadStaging> staging);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_STAGED_UPLOAD_H_
