// Runs a whole training, from dataset folders to a model folder. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_TRAINER_H_
#define MANEUVER_MODEL_LEARNING_TRAINER_H_

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_blocks.h"
#include "model/learning/checkpoint_policy.h"
#include "model/learning/ranks/rank_place.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

struct TrainingRun {
  // Complete and valid (artifact/training_presets.h).
  v1::TrainingSettings settings;
  // Folder that the model is written to; it must not exist.
  std::filesystem::path output;
  // Folder of checkpoints; empty: none are written. If it has checkpoints of the same run, the run
  // resumes from the latest one. On the CPU with the same number of threads it then ends with the
  // same weights as a run that was never stopped. Checkpoints stay when the run is over.
  std::filesystem::path checkpoints;
  // Also train the anchor baselines (anchors/anchor_learner.h), which every evaluation of the model
  // then includes. The model has the same bytes with and without them. It takes about twice the
  // time.
  bool baselines = false;
  // Bytes of memory that recordings may take, about. Datasets that fit are read whole. From larger
  // ones, the phases on scenes learn window by window. Standardization, the phases on trajectories,
  // validation, calibration and the model's own metrics use a sample (OpenTrainingData). A run that
  // continues from a checkpoint keeps the data memory that it began with, because the order of its
  // examples depends on it.
  int64_t data_memory = data::kDefaultDataMemory;
  CheckpointPolicy checkpoint_policy;
  // The run fails if fewer actions than this have a probability of 0.05 in any held-out example.
  // Not checked with fewer than a hundred held-out examples; 0: never checked.
  int least_effective_actions = 0;
  // Model folder whose weights learning starts from; its spec must be that of the settings. Empty:
  // random weights. With a start, pretraining and mixture are skipped, and actions keep their
  // numbers and labels.
  std::filesystem::path start_from;
  // Recorded in the model's provenance.
  std::string start_from_name;
  std::vector<std::string> dataset_names;
  std::string trainer_version;
  // The place of this process among several that learn one model together, if there are several.
  // All of them have the same settings and datasets. Only rank 0 uses output, checkpoints and
  // progress. All end with the same error if one fails, and if one is asked to stop.
  std::optional<RankPlace> rank;
  // The longest that a rank waits for an answer of another one.
  std::chrono::milliseconds rank_timeout{60'000};
  // The longest that a rank waits for the others to start.
  std::chrono::milliseconds rank_join_timeout{600'000};
  // Seconds of the work that follows this run and that `progress` counts as a part of it. The run
  // then ends before its fraction is 1.
  double seconds_after = 0.0;
  // Called on the calling thread; may be empty.
  std::function<void(const v1::JobProgress&)> progress;
  // Asked often, from several threads; true ends the run with CANCELLED. May be empty.
  std::function<bool()> stopped;
};

// Returns the values of TrainingSettings.device that LibTorch can use here: "cpu", and "cuda" if it
// was built with CUDA and finds a GPU.
std::vector<std::string> UsableDevices();

// From here on the processor takes denormal numbers (floats below 1.2e-38, doubles below 2.2e-308)
// as 0, in this thread and in those that it starts. Trainings meet many of them, and Intel's
// processors need far longer for each than for others. A program calls this once, before its first
// training and before other threads.
void FlushDenormals();

// Reads the folders and learns. The same settings, data and number of threads give the same weights
// on the CPU. Nothing is left at `output` unless it succeeds. A rank other than 0 returns an empty
// manifest.
// Errors, with a FailureOf (training_failure.h) where several share a code:
//   INVALID_ARGUMENT      LibTorch does not have the device here; the model to start from has
//                         another spec; the ranks' settings differ, or their number does not
//                         divide optimization.micro_batches
//   FAILED_PRECONDITION   there are too few examples; the message says how many and what to do
//   FAILED_PRECONDITION   the actions collapsed to fewer than least_effective_actions
//   FAILED_PRECONDITION   the settings ask for labels that the model to start from does not have
//   FAILED_PRECONDITION   the checkpoints belong to another run
//   DATA_LOSS, NOT_FOUND  a dataset folder, or the model to start from, is damaged or missing
//   ABORTED               the loss is no longer finite
//   RESOURCE_EXHAUSTED    memory ran out, or the disk is full
//   UNAVAILABLE           kRankLost: another rank ended, or did not answer in time
//   CANCELLED             `stopped` returned true; if checkpoints are kept, one was written
//   INTERNAL              LibTorch failed
//   others                those of artifact::WriteModelFolder
absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run,
                                        const std::vector<std::filesystem::path>& datasets);

// Does the same for data in memory.
absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run, const TrainingData& data);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINER_H_
