// The examples that a run learns from, and those that it holds out.

#ifndef MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_
#define MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/example_index.h"

namespace maneuver::learning {

// Recordings of one side of the split, and the examples in them.
struct ExampleSet {
  std::vector<v1::Scenario> recordings;
  std::vector<data::Example> examples;  // Example.recording is an index into `recordings`
};

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
};

// Reads the folders and enumerates the examples of complete settings. Annotations are for
// evaluation and, by label_share, for labels. FAILED_PRECONDITION if more manoeuvres are labelled
// than the model has actions.
//   keep_going: asked between recordings; returning false ends the call with CANCELLED.
//   learns_from: returns false for a recording that is ignored, together with its annotations;
//     empty: no recording is ignored.
// Errors: those of data::ForEachScenario; FAILED_PRECONDITION if there are fewer training examples
// than MinimumExamples, or none in a folder that has a weight. Its message says what was found and
// what to do.
absl::StatusOr<TrainingData> LoadTrainingData(
    std::span<const std::filesystem::path> folders, const v1::TrainingSettings& settings,
    const std::function<bool()>& keep_going,
    const std::function<bool(const v1::Scenario&)>& learns_from = {});

// As above, for recordings in memory.
absl::StatusOr<TrainingData> SplitRecordings(std::vector<v1::Scenario> recordings,
                                             const v1::TrainingSettings& settings);

// Returns the least number of training examples: two for each action, and two full batches.
int64_t MinimumExamples(const v1::TrainingSettings& settings);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINING_DATA_H_
