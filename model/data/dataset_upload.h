// An upload of a dataset as its receiver sees it.

#ifndef MANEUVER_MODEL_DATA_DATASET_UPLOAD_H_
#define MANEUVER_MODEL_DATA_DATASET_UPLOAD_H_

#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

// An upload of one dataset: receives the bytes of its shards, one shard after the other. Not
// thread-safe.
class DatasetUpload {
 public:
  // Keeps the arrived bytes for this caller's next upload of this name, unless Commit succeeded,
  // they cannot become this dataset (too many bytes, a wrong recording, ALREADY_EXISTS), or Discard
  // was called.
  virtual ~DatasetUpload() = default;

  // Receives the next bytes. Each error names the shard:
  //   INVALID_ARGUMENT: there are more bytes than the manifest states.
  //   DATA_LOSS: the SHA-256 of a shard differs. All its bytes are discarded, also earlier ones.
  //   RESOURCE_EXHAUSTED: the disk is full.
  //   ABORTED: another upload of this name by this caller has begun.
  virtual absl::Status Append(std::string_view bytes) = 0;
  // Reads everything back, checks it (VerifyDatasetFolder) and publishes the dataset in one step.
  // May take long.
  //   INVALID_ARGUMENT: bytes are missing, or a record is not a valid recording; names the shard,
  //     record and field.
  //   ALREADY_EXISTS: another upload of this name was committed first.
  //   DATA_LOSS: as for Append.
  virtual absl::StatusOr<v1::Dataset> Commit() = 0;
  // Drops what has arrived instead of keeping it.
  virtual void Discard() = 0;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_UPLOAD_H_
