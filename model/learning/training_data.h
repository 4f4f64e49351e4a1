// The examples that a run learns from, and those that it holds out.

#ifndef MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_
#define MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/example_set.h"
#include "model/learning/recording_windows.h"

namespace maneuver::learning {

// Says by its id whether a run learns from a recording. It ignores the others, together with their
// annotations. Empty: it learns from all.
using LearnsFrom = std::function<bool(const std::string& scenario_id)>;

struct TrainingData {
  ExampleSet training;
  ExampleSet validation;                            // whole recordings; empty if the share is 0
  std::vector<v1::ManeuverAnnotation> annotations;  // of the held-out recordings
  // The known action of each training example: an index into label_names, or -1 if it is not known.
  // Empty without label_share.
  std::vector<int> labels;
  std::vector<std::string> label_names;  // sorted
  // The number of training examples of each folder; they are in the order of the folders. Empty:
  // not known, and dataset_weights have no meaning.
  std::vector<int64_t> folder_examples;
  // All training recordings, on disk, if they do not fit in memory; null if they do. Phases on
  // scenes learn from them. `training` and `validation` are then samples.
  std::shared_ptr<const RecordingWindows> windows;
  int64_t data_memory = 0;  // bytes that the run's recordings may take; 0: not stated

  // Returns how many training examples there are, on disk or in memory.
  int64_t TrainingExamples() const;
};

// Reads the folders and enumerates the examples of complete settings. Annotations are for
// evaluation and, by label_share, for labels.
//   keep_going: asked between recordings; returning false ends the call with CANCELLED.
// Errors: those of data::ForEachScenario; INVALID_ARGUMENT if there are weights, but not one for
// each folder; FAILED_PRECONDITION if there are fewer training examples than MinimumExamples, none
// in a folder that has a weight, or more labelled manoeuvres than the model has actions. The
// messages say what was found and what to do.
absl::StatusOr<TrainingData> LoadTrainingData(std::span<const std::filesystem::path> folders,
                                              const v1::TrainingSettings& settings,
                                              const std::function<bool()>& keep_going,
                                              const LearnsFrom& learns_from = {});

// Opens folders whose recordings may take `data_memory` bytes (recording_blocks.h says what they
// take). If those that the run learns from fit, this is LoadTrainingData. If they do not,
// TrainingData.windows has all training recordings, and the other fields contain a sample of whole
// recordings. A hash of seed and id determines the order in which recordings are drawn. Each folder
// contributes in proportion to its bytes, until training recordings take a quarter of `data_memory`
// and held-out ones an eighth.
//   threads: number of threads that read recordings and count examples
// Errors: those of LoadTrainingData and RecordingWindows::Open; FAILED_PRECONDITION if the sample
// has fewer training examples than MinimumExamples.
absl::StatusOr<TrainingData> OpenTrainingData(std::span<const std::filesystem::path> folders,
                                              const v1::TrainingSettings& settings,
                                              int64_t data_memory, int threads,
                                              const std::function<bool()>& keep_going,
                                              const LearnsFrom& learns_from = {});

// Does the same as LoadTrainingData for recordings in memory.
absl::StatusOr<TrainingData> SplitRecordings(std::vector<v1::Scenario> recordings,
                                             const v1::TrainingSettings& settings);

// Returns the least number of training examples: two for each action, and two full batches. For
// settings without epochs, by which a model is recalibrated, kFewestHeldOut.
int64_t MinimumExamples(const v1::TrainingSettings& settings);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_
