#include "model/learning/recording_windows.h"

#include <iterator>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/example_index.h"
#include "model/data/recording_blocks.h"
#include "model/learning/example_counts.h"
#include "model/machine/parallel.h"

namespace maneuver::learning {

RecordingWindows::RecordingWindows(const v1::TrainingSettings& settings, int64_t window_bytes,
                                   int threads)
    : settings_(settings),
      example_settings_(TrainingExampleSettings(settings)),
      window_bytes_(window_bytes),
      threads_(threads) {}

absl::StatusOr<std::shared_ptr<RecordingWindows>> RecordingWindows::Open(
    std::span<const std::filesystem::path> folders, const v1::TrainingSettings& settings,
    int64_t data_memory, int threads, const std::function<bool()>& keep_going,
    const std::function<bool(const std::string& scenario_id)>& learns_from) {
  std::shared_ptr<RecordingWindows> windows(
      new RecordingWindows(settings, data_memory / 4, threads));
  for (const std::filesystem::path& folder : folders) {
    const absl::Status status = windows->AddFolder(folder, keep_going, learns_from);
    if (!status.ok()) return status;
  }
  return windows;
}

absl::Status RecordingWindows::AddFolder(
    const std::filesystem::path& folder, const std::function<bool()>& keep_going,
    const std::function<bool(const std::string& scenario_id)>& learns_from) {
  absl::StatusOr<data::RecordingIndex> index = data::RecordingIndex::Open(folder);
  if (!index.ok()) return index.status();
  const absl::StatusOr<std::vector<int32_t>> counts =
      CountExamplesPerRecording(folder, *index, settings_, threads_, keep_going);
  if (!counts.ok()) return counts.status();
  const int number = static_cast<int>(folders_.size());
  int64_t all_bytes = 0;
  for (size_t i = 0; i < counts->size(); ++i) {
    const data::RecordingIndex::Entry& entry = index->entries()[i];
    if (learns_from && !learns_from(entry.scenario_id)) continue;
    const auto bytes = static_cast<int64_t>(entry.payload_bytes);
    const int32_t examples = (*counts)[i];
    all_bytes += bytes;
    if (examples <= 0) continue;  // also those that are held out
    recordings_.push_back({number, i, examples, bytes * data::kMemoryPerByte});
    examples_ += examples;
  }
  folders_.push_back({*std::move(index), all_bytes});
  return absl::OkStatus();
}

std::vector<EpochWindow> RecordingWindows::Plan(int64_t epoch_steps, int epoch) const {
  const auto& weights = settings_.examples().dataset_weights();
  return PlanWindows(recordings_, {weights.data(), static_cast<size_t>(weights.size())},
                     {epoch_steps, settings_.optimization().batch_size(), window_bytes_},
                     static_cast<uint64_t>(settings_.seed()), epoch);
}

absl::StatusOr<LoadedWindow> RecordingWindows::Load(const EpochWindow& window,
                                                    const std::function<bool()>& keep_going) const {
  const size_t count = window.recordings.size();
  LoadedWindow loaded;
  loaded.set.recordings.resize(count);
  std::vector<std::vector<data::Example>> found(count);
  const absl::Status status = machine::ForEachOnThreads(count, threads_, [&](size_t i) {
    if (!keep_going()) return absl::CancelledError("stopped while reading the recordings");
    const UnreadRecording& unread = recordings_[window.recordings[i]];
    absl::StatusOr<v1::Scenario> recording = index(unread.folder).Read(unread.index);
    if (!recording.ok()) return recording.status();
    found[i] = data::EnumerateExamples(*recording, static_cast<int>(i), settings_.model(),
                                       example_settings_);
    if (static_cast<int64_t>(found[i].size()) != unread.examples) {
      return absl::DataLossError(absl::StrCat(
          "recording ", recording->scenario_id(), " has ", found[i].size(), " examples, and ",
          unread.examples,
          " were counted before; remove the files .examples-* from the dataset's folder"));
    }
    loaded.set.recordings[i] = *std::move(recording);
    return absl::OkStatus();
  });
  if (!status.ok()) return status;
  for (size_t i = 0; i < count; ++i) {
    if (labels_ != nullptr) {
      const std::string& id = loaded.set.recordings[i].scenario_id();
      for (const data::Example& example : found[i]) {
        loaded.labels.push_back(labels_->Of(id, example));
      }
    }
    std::ranges::move(found[i], std::back_inserter(loaded.set.examples));
  }
  return loaded;
}

}  // namespace maneuver::learning
