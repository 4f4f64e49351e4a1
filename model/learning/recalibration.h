// Fits the widths and the temperature of a model again, to recordings of what happened since. No
// LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_RECALIBRATION_H_
#define MANEUVER_MODEL_LEARNING_RECALIBRATION_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_blocks.h"

namespace maneuver::learning {

struct RecalibrationRun {
  std::filesystem::path model;   // folder of the model to recalibrate
  std::string model_name;        // recorded as what the new model starts from
  std::filesystem::path output;  // folder that the new model is written to; it must not exist
  // Complete. The recordings of validation_share are not fitted to; the new model is measured on
  // them.
  v1::ExampleSettings examples;
  std::vector<std::string> dataset_names;
  std::string trainer_version;
  int threads = 0;  // 0: one for each core
  // Bytes of memory that recordings may take, about. Of larger datasets a sample is used.
  int64_t data_memory = data::kDefaultDataMemory;
  // Called on the calling thread; may be empty.
  std::function<void(const v1::JobProgress&)> progress;
  // Asked often, from several threads; true ends the run with CANCELLED. May be empty.
  std::function<bool()> stopped;
};

// Writes a model whose weights have the same bytes as those of run.model, apart from the tensors
// that RecalibrateModel (calibration.h) fits. Its actions keep their names and their usage: the
// scenes that the model has learned are the same. Its metrics are those of the held-out recordings.
// Nothing is left at `output` unless it succeeds.
// Errors: those of Train (trainer.h). FAILED_PRECONDITION with
// TrainingFailure::kNotEnoughExamples if there are fewer than 100 examples to fit to.
absl::StatusOr<v1::ModelManifest> Recalibrate(const RecalibrationRun& run,
                                              const std::vector<std::filesystem::path>& datasets);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RECALIBRATION_H_
