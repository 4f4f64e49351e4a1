#include "model/learning/trainer.h"

#include <ATen/Parallel.h>
#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/evaluation/action_names.h"
#include "model/learning/anchors/anchor_learner.h"
#include "model/learning/export.h"
#include "model/learning/learner.h"
#include "model/learning/run_progress.h"
#include "model/learning/tensors.h"
#include "model/learning/training_failure.h"
#include "model/machine/usable_cores.h"

namespace maneuver::learning {
namespace {

absl::StatusOr<at::Device> FindDevice(const std::string& name) {
  if (name == "cpu") return at::Device(at::kCPU);
  if (name == "cuda" && at::hasCUDA()) return at::Device(at::kCUDA);
  return absl::InvalidArgumentError(
      absl::StrCat("device: LibTorch has no \"", name, "\" here; use \"cpu\""));
}

int Threads(const v1::TrainingSettings& settings) {
  if (settings.threads() > 0) return settings.threads();
  return machine::UsableCores();
}

// Returns the data memory that the run's latest checkpoint began with, or else the run's.
absl::StatusOr<int64_t> DataMemory(const TrainingRun& run) {
  if (run.checkpoints.empty()) return run.data_memory;
  const absl::StatusOr<CheckpointFolder> folder =
      CheckpointFolder::Open(run.checkpoints, run.checkpoint_policy);
  if (!folder.ok()) return folder.status();
  const std::optional<Checkpoint> latest = folder->ReadLatest();
  return latest && latest->data_memory() > 0 ? latest->data_memory() : run.data_memory;
}

// All phases on loaded data.
class Training {
 public:
  Training(const TrainingRun& run, at::Device device)
      : run_(run),
        device_(device),
        stopped_(run.stopped ? run.stopped : [] { return false; }),
        progress_(
            Plan(run, run.settings.examples().max_examples(),
                 run.settings.examples().max_examples(), run.settings.examples().max_examples()),
            run.progress, [] { return std::chrono::system_clock::now(); }) {}

  absl::StatusOr<TrainingData> Load(const std::vector<std::filesystem::path>& datasets) {
    progress_.BeginPhase("load");
    const absl::StatusOr<int64_t> data_memory = DataMemory(run_);
    if (!data_memory.ok()) return data_memory.status();
    return OpenTrainingData(datasets, run_.settings, *data_memory, Threads(run_.settings),
                            [this] { return !stopped_(); });
  }

  absl::StatusOr<v1::ModelManifest> Learn(const TrainingData& data) {
    progress_.Replan(Plan(run_, data.TrainingExamples(),
                          static_cast<int64_t>(data.training.examples.size()),
                          static_cast<int64_t>(data.validation.examples.size())));
    const int threads = Threads(run_.settings);
    Learner learner(run_.settings, data, device_, threads, stopped_, progress_);
    GivenNames given{.labels = data.label_names};
    if (!run_.start_from.empty()) {
      absl::StatusOr<GivenNames> started = Start(data, learner);
      if (!started.ok()) return started.status();
      given = *std::move(started);
    }
    std::optional<CheckpointFolder> checkpoints;
    if (!run_.checkpoints.empty()) {
      absl::StatusOr<CheckpointFolder> opened =
          CheckpointFolder::Open(run_.checkpoints, run_.checkpoint_policy);
      if (!opened.ok()) return opened.status();
      checkpoints = *std::move(opened);
      const absl::Status status = learner.KeepCheckpoints(&*checkpoints);
      if (!status.ok()) return status;
    }
    if (absl::Status status = learner.Learn(); !status.ok()) return status;
    ExportOptions options;
    if (run_.baselines) {
      AnchorLearner anchors(learner.state(), learner.loop());
      absl::StatusOr<artifact::StoredBaselines> baselines = anchors.Learn();
      if (!baselines.ok()) return baselines.status();
      options.baselines = *std::move(baselines);
    }
    progress_.BeginPhase("export");
    artifact::StoredModel model{Describe(data), learner.state().networks.Export()};
    progress_.BeginPhase("evaluate");
    options.output = run_.output;
    options.threads = threads;
    options.labels = std::move(given.labels);
    options.names = std::move(given.derived);
    options.least_effective_actions = run_.least_effective_actions;
    int64_t reported = 0;  // hundredths, as the plan has it
    options.progress = [this, &reported](int64_t done, int64_t total) {
      for (const int64_t now = 100 * done / std::max<int64_t>(1, total); reported < now;
           ++reported) {
        progress_.Step(0);
      }
      return !stopped_();
    };
    return ExportModel(std::move(model), data, run_.settings.examples(), options);
  }

 private:
  static std::vector<RunProgress::Phase> Plan(const TrainingRun& run, int64_t training_examples,
                                              int64_t examples_in_memory,
                                              int64_t held_out_examples) {
    std::vector<RunProgress::Phase> plan =
        Learner::Plan(run.settings, training_examples, examples_in_memory, held_out_examples,
                      !run.start_from.empty());
    if (run.baselines) AnchorLearner::AddPhases(run.settings, training_examples, &plan);
    return plan;
  }

  // Names that the actions have before anything is learned.
  struct GivenNames {
    std::vector<std::string> labels = {};   // of the first actions
    std::vector<std::string> derived = {};  // [K], or empty: they are still to be made
  };

  // Gives the learner the model to start from. Returns the names of its actions, which stay what
  // they are.
  absl::StatusOr<GivenNames> Start(const TrainingData& data, Learner& learner) const {
    const absl::StatusOr<artifact::StoredModel> start = artifact::ReadModelFolder(run_.start_from);
    if (!start.ok()) return start.status();
    v1::ModelSpec spec = start->manifest.spec();
    spec.set_objective(run_.settings.model().objective());
    if (!google::protobuf::util::MessageDifferencer::Equals(spec, run_.settings.model())) {
      return absl::InvalidArgumentError("model: must be that of the version to start from");
    }
    v1::ModelManifest manifest = start->manifest;
    evaluation::CompleteActionNames(manifest);
    GivenNames given;
    for (const v1::Action& action : manifest.actions()) {
      given.labels.push_back(action.label());
      given.derived.push_back(action.derived_name());
    }
    const std::vector<std::string>& labels = given.labels;
    for (size_t i = 0; i < data.label_names.size(); ++i) {
      if (i < labels.size() && labels[i] == data.label_names[i]) continue;
      return absl::FailedPreconditionError(absl::StrCat(
          "action ", i, " of the version to start from is not labelled \"", data.label_names[i],
          "\", as these recordings would have it; set examples.label_share to 0, or train from the "
          "beginning"));
    }
    learner.StartFrom(start->weights, start->manifest.weights_sha256());
    return given;
  }

  v1::ModelManifest Describe(const TrainingData& data) const {
    v1::ModelManifest manifest;
    *manifest.mutable_spec() = run_.settings.model();
    v1::Provenance& provenance = *manifest.mutable_provenance();
    for (const std::string& name : run_.dataset_names) provenance.add_datasets(name);
    provenance.set_start_from(run_.start_from_name);
    *provenance.mutable_settings() = run_.settings;
    provenance.mutable_train_time()->set_seconds(
        std::chrono::duration_cast<std::chrono::seconds>(
            std::chrono::system_clock::now().time_since_epoch())
            .count());
    provenance.set_trainer_version(run_.trainer_version);
    provenance.set_training_examples(data.TrainingExamples());
    provenance.set_validation_examples(static_cast<int64_t>(data.validation.examples.size()));
    return manifest;
  }

  const TrainingRun& run_;
  const at::Device device_;
  const std::function<bool()> stopped_;
  RunProgress progress_;
};

absl::Status OutOfMemory() {
  return WithFailure(absl::ResourceExhaustedError(
                         "out of memory; use fewer recordings, smaller networks or batches, or "
                         "raise the limit of the job"),
                     TrainingFailure::kOutOfMemory);
}

// Runs `work` with LibTorch set up; its exceptions become a Status here and go no further.
absl::StatusOr<v1::ModelManifest> Guarded(
    const TrainingRun& run,
    const std::function<absl::StatusOr<v1::ModelManifest>(at::Device)>& work) {
  try {
    const absl::StatusOr<at::Device> device = FindDevice(run.settings.device());
    if (!device.ok()) return device.status();
    at::set_num_threads(Threads(run.settings));
    at::globalContext().setDeterministicAlgorithms(true, /*warn_only=*/true);
    return work(*device);
  } catch (const c10::Error& error) {
    const std::string what = error.what_without_backtrace();
    // LibTorch's allocators of CPU and GPU have no exception of their own in all versions.
    if (what.find("allocate memory") != what.npos || what.find("out of memory") != what.npos) {
      return OutOfMemory();
    }
    return absl::InternalError(absl::StrCat("LibTorch: ", what));
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("LibTorch: ", error.what()));
  }
}

}  // namespace

std::vector<std::string> UsableDevices() {
  if (at::hasCUDA()) return {"cpu", "cuda"};
  return {"cpu"};
}

absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run,
                                        const std::vector<std::filesystem::path>& datasets) {
  return Guarded(run, [&](at::Device device) -> absl::StatusOr<v1::ModelManifest> {
    Training training(run, device);
    const absl::StatusOr<TrainingData> data = training.Load(datasets);
    if (!data.ok()) return data.status();
    return training.Learn(*data);
  });
}

absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run, const TrainingData& data) {
  return Guarded(run, [&](at::Device device) {
    Training training(run, device);
    return training.Learn(data);
  });
}

}  // namespace maneuver::learning
