// The list of the datasets in a folder that several servers may share.
//
// A dataset exists when the ledger says so, and the ledger says so once the folder is complete. The
// folder has a copy of the manifest, which those that read the shards use. So the ledger answers
// what exists without the folder, and a training reads a dataset without the ledger.

#ifndef MANEUVER_MODEL_DATA_DATASET_LEDGER_H_
#define MANEUVER_MODEL_DATA_DATASET_LEDGER_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

// A change is durable once its call has returned OK. If it returns another error than those named
// below, it may have been made all the same. Safe to use from any thread. Errors of every method:
// those of the store; DATA_LOSS for an entry that is damaged.
class DatasetLedger {
 public:
  virtual ~DatasetLedger() = default;

  // Returns at most `limit` manifests, by id, that come after the id `after`. One that is damaged
  // has a name alone.
  virtual absl::StatusOr<std::vector<v1::Dataset>> List(const std::string& after, size_t limit) = 0;
  // Returns all ids, sorted.
  virtual absl::StatusOr<std::vector<std::string>> ListIds() = 0;
  // NOT_FOUND if there is no such dataset.
  virtual absl::StatusOr<v1::Dataset> Get(const std::string& id) = 0;
  // Returns the sum of the bytes that Add was given.
  virtual absl::StatusOr<int64_t> TotalBytes() = 0;

  // Adds a dataset, and calls `publish` before others see it: it must put the folder in its place,
  // or find it there. While it runs nobody else adds or removes the dataset; it must be short and
  // must not call the store. ALREADY_EXISTS if the dataset is on the list; INVALID_ARGUMENT if it
  // has no valid name; the error of `publish`. Then the list is as it was.
  //   manifest: with the name datasets/{id}
  //   bytes: that the shards take in the folder; 0 if they lie elsewhere (registered_folder.h)
  virtual absl::Status Add(const v1::Dataset& manifest, int64_t bytes,
                           const std::function<absl::Status()>& publish) = 0;
  // Removes a dataset, and calls `remove`, which must take the folder away, in the same way.
  // NOT_FOUND if it is not on the list; the error of `remove`. Then the list is as it was.
  virtual absl::Status Remove(const std::string& id,
                              const std::function<absl::Status()>& remove) = 0;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_DATASET_LEDGER_H_
