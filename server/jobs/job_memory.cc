#include "server/jobs/job_memory.h"

#include <algorithm>

#include "model/artifact/calibration_examples.h"
#include "model/artifact/model_cost.h"
#include "model/data/recording_blocks.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

// The program with its libraries, before it reads anything. Measured.
constexpr int64_t kProgramBytes = int64_t{180} << 20;
// Of each recording, where data are read piece by piece: its place, its id, its number of examples.
constexpr int64_t kIndexBytes = 200;
// What a cross-validation measures on each example, for each seed, by the bytes of the recordings on
// disk. Measured on Waymo Open Motion: 15 examples of 1.3 kB in 390 kB.
constexpr int64_t kRecordingBytesPerMeasuredByte = 20;
// Weights, gradients, two moments, and the best weights so far.
constexpr int64_t kCopiesOfWeights = 5;

// What calibration takes: the predictions, and the gradients of their covariances.
int64_t CalibrationBytes(const v1::ModelSpec& spec, bool fit, int64_t data_memory) {
  const artifact::CalibrationExamples examples =
      fit ? artifact::CalibrationExamples() : artifact::CalibrationExamplesIn(spec, data_memory);
  const int64_t kept = examples.held_out + (spec.has_scene_covariance() ? 0 : examples.training);
  return 2 * kept * artifact::PredictionBytes(spec);
}

}  // namespace

absl::StatusOr<v1::JobMemory> EstimateMemory(const v1::Job& job, const v1::ModelSpec& spec,
                                             const data::DatasetStore& datasets,
                                             int64_t data_memory) {
  v1::JobMemory memory;
  int64_t recordings = 0;
  for (const std::string& id : DatasetIds(job)) {
    absl::StatusOr<v1::Dataset> dataset = datasets.Read(id);
    if (!dataset.ok()) return WithDefaultReason(dataset.status(), "DATASET_DAMAGED");
    recordings += dataset->recordings();
    for (const v1::Shard& shard : dataset->shards()) {
      if (shard.content() != v1::SHARD_CONTENT_SCENARIOS) continue;
      memory.set_recording_bytes(memory.recording_bytes() + shard.size_bytes());
    }
  }
  const bool fit = data::FitInMemory(memory.recording_bytes(), data_memory);
  memory.set_data_fit(fit);
  memory.set_data_bytes(fit ? memory.recording_bytes() * data::kMemoryPerByte
                            : data_memory + recordings * kIndexBytes);
  const int64_t weights =
      static_cast<int64_t>(sizeof(float)) * artifact::CountCost(spec).parameters();
  if (job.has_evaluate()) {
    memory.set_network_bytes(weights);
  } else if (job.has_recalibrate()) {
    memory.set_network_bytes(2 * weights);  // the networks, and the model that they came from
    memory.set_working_bytes(CalibrationBytes(spec, fit, data_memory));
  } else {
    const v1::TrainingSettings& settings =
        job.has_train() ? job.train().settings() : job.cross_validate().settings();
    memory.set_network_bytes(kCopiesOfWeights * weights);
    memory.set_working_bytes(
        std::max(settings.optimization().batch_size() * artifact::ExampleBytes(spec),
                 CalibrationBytes(spec, fit, data_memory)));
  }
  if (job.has_cross_validate()) {
    const int64_t seeds = std::max(1, job.cross_validate().seeds_size());
    memory.set_working_bytes(memory.working_bytes() +
                             seeds * memory.recording_bytes() / kRecordingBytesPerMeasuredByte);
  }
  memory.set_total_bytes(kProgramBytes + memory.data_bytes() + memory.network_bytes() +
                         memory.working_bytes());
  return memory;
}

}  // namespace maneuver::jobs
