#include "server/jobs/trainer/dataset_measurement.h"

#include <chrono>
#include <utility>

#include "model/evaluation/evaluator.h"
#include "model/learning/measuring_time.h"
#include "model/machine/usable_cores.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

DatasetMeasurement::DatasetMeasurement(std::shared_ptr<const inference::ActionModel> model,
                                       std::optional<inference::AnchorBaselines> baselines,
                                       Recordings recordings)
    : model_(std::move(model)),
      baselines_(std::move(baselines)),
      recordings_(std::move(recordings)) {}

absl::StatusOr<DatasetMeasurement> DatasetMeasurement::Open(const std::filesystem::path& model,
                                                            const std::filesystem::path& dataset,
                                                            int64_t data_memory) {
  auto loaded = inference::ActionModel::Load(model, {});
  if (!loaded.ok()) return OfFolder(loaded.status(), model);
  auto baselines = inference::LoadAnchorBaselines(model, {});
  if (!baselines.ok() && !absl::IsNotFound(baselines.status())) return baselines.status();
  auto recordings = OpenRecordings(dataset, data_memory);
  if (!recordings.ok()) return recordings.status();
  return DatasetMeasurement(*std::move(loaded),
                            baselines.ok() ? std::optional(*std::move(baselines)) : std::nullopt,
                            *std::move(recordings));
}

absl::StatusOr<v1::EvaluationReport> DatasetMeasurement::Measure(
    const v1::ExampleSettings& examples, int sampled_examples, int threads,
    std::function<bool(int64_t done, int64_t total)> progress) const {
  evaluation::EvaluationInput input;
  input.blocks = &recordings_.blocks;
  input.annotations = recordings_.annotations;
  input.examples = examples;
  input.sampled_examples = sampled_examples;
  if (baselines_) input.baselines = &*baselines_;
  input.threads = threads > 0 ? threads : machine::UsableCores();
  input.progress = std::move(progress);
  return evaluation::Evaluate(*model_, input);
}

absl::StatusOr<double> MeasuringSeconds(const std::filesystem::path& model,
                                        const std::filesystem::path& dataset, int64_t data_memory,
                                        const v1::ExampleSettings& examples, int threads) {
  learning::MeasuringTime time([] { return std::chrono::system_clock::now(); });
  const auto measurement = DatasetMeasurement::Open(model, dataset, data_memory);
  if (!measurement.ok()) return measurement.status();
  bool is_enough = false;
  const auto measured =
      measurement->Measure(examples, 0, threads, [&](int64_t done, int64_t total) {
        is_enough = !time.Continue(done, total);
        return !is_enough && !StopRequested();
      });
  if (!measured.ok() && !is_enough) return measured.status();
  const std::optional<double> seconds = time.Seconds();
  if (!seconds) return absl::UnavailableError("there are too few examples to tell");
  return *seconds;
}

}  // namespace maneuver::trainer
