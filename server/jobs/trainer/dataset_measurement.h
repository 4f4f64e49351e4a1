// Measures a model folder on a dataset folder.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_DATASET_MEASUREMENT_H_
#define MANEUVER_SERVER_JOBS_TRAINER_DATASET_MEASUREMENT_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"
#include "server/jobs/trainer/recordings.h"

namespace maneuver::trainer {

class DatasetMeasurement {
 public:
  // Loads the model and its baselines, and opens the dataset. Errors: those of ActionModel::Load,
  // LoadAnchorBaselines and OpenRecordings.
  //   data_memory: bytes that recordings may take
  static absl::StatusOr<DatasetMeasurement> Open(const std::filesystem::path& model,
                                                 const std::filesystem::path& dataset,
                                                 int64_t data_memory);

  // Measures the examples of all recordings. Errors: those of evaluation::Evaluate.
  //   examples: complete
  //   sampled_examples, progress: as in evaluation::EvaluationInput
  //   threads: 0: one for each core
  absl::StatusOr<v1::EvaluationReport> Measure(
      const v1::ExampleSettings& examples, int sampled_examples, int threads,
      std::function<bool(int64_t done, int64_t total)> progress) const;

 private:
  DatasetMeasurement(std::shared_ptr<const inference::ActionModel> model,
                     std::optional<inference::AnchorBaselines> baselines, Recordings recordings);

  std::shared_ptr<const inference::ActionModel> model_;
  std::optional<inference::AnchorBaselines> baselines_;
  Recordings recordings_;
};

// Measures for a second and estimates from that how many seconds Open and Measure take together.
// Errors: those of both; UNAVAILABLE if there are too few examples to tell.
absl::StatusOr<double> MeasuringSeconds(const std::filesystem::path& model,
                                        const std::filesystem::path& dataset, int64_t data_memory,
                                        const v1::ExampleSettings& examples, int threads);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_DATASET_MEASUREMENT_H_
