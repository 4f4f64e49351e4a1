#include "model/learning/recalibration.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/action_names.h"
#include "model/learning/calibration.h"
#include "model/learning/export.h"
#include "model/learning/learner.h"
#include "model/learning/networks.h"
#include "model/learning/phases/calibrate.h"
#include "model/learning/provenance.h"
#include "model/learning/run_examples.h"
#include "model/learning/scene_source.h"
#include "model/learning/torch_errors.h"
#include "model/learning/training_data.h"
#include "model/learning/training_failure.h"
#include "model/learning/training_progress.h"
#include "model/learning/validation.h"
#include "model/machine/usable_cores.h"

namespace maneuver::learning {
namespace {

// The settings of the model's training, without the epochs: nothing is learned.
v1::TrainingSettings SettingsOf(const v1::ModelManifest& manifest,
                                const v1::ExampleSettings& examples) {
  v1::TrainingSettings settings =
      artifact::ResolveTrainingSettings(manifest.provenance().settings());
  *settings.mutable_model() = manifest.spec();
  *settings.mutable_examples() = examples;
  settings.mutable_examples()->clear_label_share();
  settings.mutable_examples()->clear_dataset_weights();
  v1::OptimizationSettings& optimization = *settings.mutable_optimization();
  optimization.set_pretraining_epochs(0);
  optimization.set_mixture_epochs(0);
  optimization.set_joint_epochs(0);
  optimization.set_posterior_epochs(0);
  optimization.set_covariance_epochs(0);
  return settings;
}

class Recalibration {
 public:
  explicit Recalibration(const RecalibrationRun& run)
      : run_(run),
        threads_(run.threads > 0 ? run.threads : machine::UsableCores()),
        stopped_(run.stopped ? run.stopped : [] { return false; }),
        progress_(Plan({}, 0, 0), run.progress, [] { return std::chrono::system_clock::now(); }) {}

  absl::StatusOr<v1::ModelManifest> Run(const std::vector<std::filesystem::path>& datasets) {
    at::set_num_threads(threads_);
    at::globalContext().setDeterministicAlgorithms(true, /*warn_only=*/true);
    progress_.BeginPhase("load");
    absl::StatusOr<artifact::StoredModel> model = artifact::ReadModelFolder(run_.model);
    if (!model.ok()) return model.status();
    const v1::TrainingSettings settings = SettingsOf(model->manifest, run_.examples);
    const absl::StatusOr<TrainingData> data = Load(settings, datasets);
    if (!data.ok()) return data.status();
    const RunExamples examples = CountRunExamples(settings.model(), *data);
    const int64_t most = std::min(examples.in_memory, examples.most_calibrated.held_out);
    progress_.Replan(Plan(settings.model(), most, examples.held_out));
    const absl::Status fitted = Fit(settings, *data, most, *model);
    if (!fitted.ok()) return fitted;
    return Export(settings, *data, *std::move(model));
  }

 private:
  static std::vector<TrainingProgress::Phase> Plan(const v1::ModelSpec& spec, int64_t fitted,
                                                   int64_t held_out) {
    // The costs of a batch that is encoded and of a step of the measured examples, about.
    constexpr double kEncodeCost = 3.0;
    constexpr double kMeasureCost = 0.3;
    const auto measured = static_cast<double>(std::min(held_out, kMostMeasured));
    return {{"load", 1, 1, 1.0},
            CalibrationPhase(kCalibratePhase, PlanRecalibration(spec, fitted), kEncodeCost),
            {kExportPhase, 1, 1, 1.0},
            {kEvaluatePhase, 1, kEvaluateSteps, kMeasureCost * measured / kEvaluateSteps}};
  }

  absl::StatusOr<TrainingData> Load(v1::TrainingSettings settings,
                                    const std::vector<std::filesystem::path>& datasets) const {
    settings.mutable_optimization()->set_batch_size(1);  // no batch has to be full
    return OpenTrainingData(datasets, settings, run_.data_memory, threads_,
                            [this] { return !stopped_(); });
  }

  // Puts the tensors that calibration changes into the model, and leaves the bytes of the others.
  absl::Status Fit(const v1::TrainingSettings& settings, const TrainingData& data, int64_t most,
                   artifact::StoredModel& model) {
    progress_.BeginPhase(kCalibratePhase);
    progress_.BeginEpoch(1);
    at::Generator generator = MakeGenerator(static_cast<uint64_t>(settings.seed()));
    Networks networks(settings.model(), at::Device(at::kCPU), generator);
    networks.Standardize(Trajectories(data.training.examples), settings.augmentation().mirror());
    networks.Import(model.weights);
    const SceneSource source(settings.model(), data.training, threads_);
    const artifact::TensorMap before = networks.Export();
    const absl::Status status =
        RecalibrateModel(networks, source, most, settings.optimization().covered_share(), threads_,
                         stopped_, StepsOf(progress_));
    if (absl::IsFailedPrecondition(status)) {
      return WithFailure(status, TrainingFailure::kNotEnoughExamples);
    }
    if (!status.ok()) return status;
    for (auto& [name, tensor] : networks.Export()) {
      if (tensor.values != before.at(name).values) model.weights[name] = std::move(tensor);
    }
    return absl::OkStatus();
  }

  absl::StatusOr<v1::ModelManifest> Export(const v1::TrainingSettings& settings,
                                           const TrainingData& data, artifact::StoredModel model) {
    progress_.BeginPhase(kExportPhase);
    ExportOptions options;
    options.output = run_.output;
    options.threads = threads_;
    evaluation::CompleteActionNames(model.manifest);
    for (const v1::Action& action : model.manifest.actions()) {
      options.labels.push_back(action.label());
      options.names.push_back(action.derived_name());
      v1::ActionUse& use = options.uses.emplace_back();
      use.set_probability(action.usage());
      use.set_largest_probability(action.effective() ? 1.0 : 0.0);
    }
    absl::StatusOr<artifact::StoredBaselines> baselines = artifact::ReadBaselines(run_.model);
    if (baselines.ok()) {
      options.baselines = *std::move(baselines);
    } else if (!absl::IsNotFound(baselines.status())) {
      return baselines.status();
    }
    Describe(settings, data, &model.manifest);
    progress_.BeginPhase(kEvaluatePhase);
    ExampleSteps measured(progress_, kEvaluateSteps);
    options.progress = [this, &measured](int64_t done, int64_t total) {
      measured.Reach(done, total);
      return !stopped_();
    };
    return ExportModel(std::move(model), data, run_.examples, options);
  }

  void Describe(const v1::TrainingSettings& settings, const TrainingData& data,
                v1::ModelManifest* manifest) const {
    manifest->clear_actions();
    manifest->clear_metrics();
    manifest->clear_rivals();
    *manifest->mutable_provenance() =
        MakeProvenance(settings, data, run_.dataset_names, run_.model_name, run_.trainer_version);
  }

  const RecalibrationRun& run_;
  const int threads_;
  const std::function<bool()> stopped_;
  TrainingProgress progress_;
};

}  // namespace

absl::StatusOr<v1::ModelManifest> Recalibrate(const RecalibrationRun& run,
                                              const std::vector<std::filesystem::path>& datasets) {
  return WithoutExceptions([&] { return Recalibration(run).Run(datasets); });
}

}  // namespace maneuver::learning
