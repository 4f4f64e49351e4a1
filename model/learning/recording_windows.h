// Training recordings that do not fit in memory together. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_RECORDING_WINDOWS_H_
#define MANEUVER_MODEL_LEARNING_RECORDING_WINDOWS_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_index.h"
#include "model/learning/epoch_windows.h"
#include "model/learning/example_set.h"
#include "model/learning/training_labels.h"

namespace maneuver::learning {

// The recordings of a window in memory, with all their examples.
struct LoadedWindow {
  ExampleSet set;
  std::vector<int> labels;  // labels of the examples, as in TrainingData
};

// The training recordings of a run by their place on disk, and how many examples each has. Takes
// some 200 bytes of memory a recording. Immutable once it has its labels; then safe to use from any
// thread.
class RecordingWindows {
 public:
  // Opens the indexes of the folders and counts the examples of each training recording.
  //   settings: complete
  //   data_memory: bytes, of which a window takes a quarter: one is learned from while the next one
  //   is read
  //   threads: number of threads that count examples and read a window
  //   keep_going: asked between recordings, from several threads; false ends it with CANCELLED
  //   learns_from: says by its id whether a recording is learned from; empty: all are
  // Errors: those of data::RecordingIndex::Open and CountExamplesPerRecording.
  static absl::StatusOr<std::shared_ptr<RecordingWindows>> Open(
      std::span<const std::filesystem::path> folders, const v1::TrainingSettings& settings,
      int64_t data_memory, int threads, const std::function<bool()>& keep_going,
      const std::function<bool(const std::string& scenario_id)>& learns_from = {});

  // Gives the examples their labels; null: they have none.
  void SetLabels(std::shared_ptr<const TrainingLabels> labels) { labels_ = std::move(labels); }

  // Returns the number of training examples in all folders.
  int64_t examples() const { return examples_; }
  // Returns all training recordings that have examples.
  std::span<const UnreadRecording> recordings() const { return recordings_; }
  const data::RecordingIndex& index(int folder) const {
    return folders_[static_cast<size_t>(folder)].index;
  }
  // Returns the bytes on disk of the recordings of a folder that are learned from or held out.
  int64_t bytes(int folder) const { return folders_[static_cast<size_t>(folder)].bytes; }

  // Returns the windows of an epoch of `epoch_steps` steps.
  //   epoch: number of epochs before it
  std::vector<EpochWindow> Plan(int64_t epoch_steps, int epoch) const;
  // Reads the recordings of a window of Plan.
  //   keep_going: as in Open
  // DATA_LOSS if one is damaged, or has other examples than were counted.
  absl::StatusOr<LoadedWindow> Load(const EpochWindow& window,
                                    const std::function<bool()>& keep_going) const;

 private:
  struct Folder {
    data::RecordingIndex index;
    int64_t bytes = 0;
  };

  RecordingWindows(const v1::TrainingSettings& settings, int64_t window_bytes, int threads);
  absl::Status AddFolder(const std::filesystem::path& folder,
                         const std::function<bool()>& keep_going,
                         const std::function<bool(const std::string& scenario_id)>& learns_from);

  const v1::TrainingSettings settings_;
  const v1::ExampleSettings example_settings_;  // with the stride of training
  const int64_t window_bytes_;                  // of memory
  const int threads_;
  std::vector<Folder> folders_;
  std::vector<UnreadRecording> recordings_;
  std::shared_ptr<const TrainingLabels> labels_;
  int64_t examples_ = 0;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RECORDING_WINDOWS_H_
