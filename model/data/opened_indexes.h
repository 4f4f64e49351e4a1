// Keeps the indexes of the datasets that were asked for last.

#ifndef MANEUVER_MODEL_DATA_OPENED_INDEXES_H_
#define MANEUVER_MODEL_DATA_OPENED_INDEXES_H_

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <list>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "maneuver/v1/dataset.pb.h"
#include "model/data/recording_index.h"

namespace maneuver::data {

// An index, and where in it each recording is.
struct OpenedIndex {
  OpenedIndex() = default;
  OpenedIndex(const OpenedIndex&) = delete;
  OpenedIndex& operator=(const OpenedIndex&) = delete;

  RecordingIndex recordings;
  std::unordered_map<std::string_view, size_t> numbers;  // by scenario id
};

// Thread-safe.
class OpenedIndexes {
 public:
  //   most_recordings: of all indexes that are kept, some 200 bytes of memory each. A dataset with
  //     more than that is indexed anew for each call.
  explicit OpenedIndexes(size_t most_recordings) : most_recordings_(most_recordings) {}

  // Returns the index of a dataset, from memory if its manifest is still the same. Errors: those of
  // RecordingIndex::Open.
  absl::StatusOr<std::shared_ptr<const OpenedIndex>> Open(const std::filesystem::path& folder,
                                                          const v1::Dataset& manifest);
  // Forgets the index of a folder.
  void Forget(const std::filesystem::path& folder);

 private:
  void ForgetLocked(const std::filesystem::path& folder) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  struct Kept {
    std::filesystem::path folder;
    int64_t created = 0;  // of the manifest, nanoseconds since 1970
    std::shared_ptr<const OpenedIndex> index;
  };

  const size_t most_recordings_;
  Mutex mutex_;
  std::list<Kept> kept_ ABSL_GUARDED_BY(mutex_);  // most recently asked for first
  size_t recordings_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_OPENED_INDEXES_H_
