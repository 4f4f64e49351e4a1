#include "model/data/opened_indexes.h"

#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <utility>

namespace maneuver::data {

absl::StatusOr<std::shared_ptr<const OpenedIndex>> OpenedIndexes::Open(
    const std::filesystem::path& folder, const v1::Dataset& manifest) {
  const int64_t created =
      google::protobuf::util::TimeUtil::TimestampToNanoseconds(manifest.create_time());
  {
    const MutexLock lock(mutex_);
    const auto found = std::ranges::find(kept_, folder, &Kept::folder);
    if (found != kept_.end() && found->created == created) {
      kept_.splice(kept_.begin(), kept_, found);
      return found->index;
    }
  }
  absl::StatusOr<RecordingIndex> opened = RecordingIndex::Open(folder);
  if (!opened.ok()) return opened.status();
  const auto index = std::make_shared<OpenedIndex>();
  index->recordings = *std::move(opened);
  const auto& entries = index->recordings.entries();
  for (size_t i = 0; i < entries.size(); ++i) index->numbers.emplace(entries[i].scenario_id, i);
  if (entries.size() > most_recordings_) return index;
  const MutexLock lock(mutex_);
  ForgetLocked(folder);
  kept_.push_front({folder, created, index});
  recordings_ += entries.size();
  while (recordings_ > most_recordings_) {
    recordings_ -= kept_.back().index->recordings.entries().size();
    kept_.pop_back();
  }
  return index;
}

void OpenedIndexes::Forget(const std::filesystem::path& folder) {
  const MutexLock lock(mutex_);
  ForgetLocked(folder);
}

void OpenedIndexes::ForgetLocked(const std::filesystem::path& folder) {
  const auto found = std::ranges::find(kept_, folder, &Kept::folder);
  if (found == kept_.end()) return;
  recordings_ -= found->index->recordings.entries().size();
  kept_.erase(found);
}

}  // namespace maneuver::data
