#include "model/learning/trainer.h"

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/action_names.h"
#include "model/learning/anchors/anchor_learner.h"
#include "model/learning/checkpoint_contents.h"
#include "model/learning/export.h"
#include "model/learning/learner.h"
#include "model/learning/provenance.h"
#include "model/learning/ranks/rank_group.h"
#include "model/learning/run_examples.h"
#include "model/learning/tensors.h"
#include "model/learning/torch_errors.h"
#include "model/learning/training_progress.h"
#include "model/machine/usable_cores.h"

namespace maneuver::learning {
namespace {

// About what a step of cost 1 takes, before any is rehearsed.
constexpr double kSecondsPerCost = 0.0025;

absl::StatusOr<at::Device> FindDevice(const TrainingRun& run) {
  const std::string& name = run.settings.device();
  if (name == "cpu") return at::Device(at::kCPU);
  if (name == "cuda" && at::hasCUDA()) {
    // Without it, products on a GPU differ from run to run (cuBLAS, "Results reproducibility").
    setenv("CUBLAS_WORKSPACE_CONFIG", ":4096:8", /*overwrite=*/0);
    const int index = run.rank ? run.rank->local_rank : 0;
    return at::Device(at::kCUDA, static_cast<at::DeviceIndex>(index));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("device: LibTorch has no \"", name, "\" here; use \"cpu\""));
}

int Threads(const TrainingRun& run) {
  if (run.settings.threads() > 0) return run.settings.threads();
  const int sharing = run.rank ? std::max(1, run.rank->local_ranks) : 1;
  return std::max(1, machine::UsableCores() / sharing);
}

// Returns what the run's latest checkpoint began with, where the run leaves it open. Otherwise the
// number of processes could not change from one start to the next.
absl::StatusOr<RankPlan> PlanRun(const TrainingRun& run) {
  v1::TrainingSettings settings = run.settings;
  std::optional<Checkpoint> latest;
  if (!run.checkpoints.empty()) {
    const absl::StatusOr<CheckpointFolder> folder =
        CheckpointFolder::Open(run.checkpoints, run.checkpoint_policy);
    if (!folder.ok()) return folder.status();
    latest = folder->ReadLatest();
  }
  if (settings.optimization().micro_batches() == 0) {
    v1::TrainingSettings earlier;
    if (latest) earlier.ParseFromString(latest->settings());
    const int count = latest ? earlier.optimization().micro_batches()
                             : (run.rank ? artifact::kMicroBatchesOfRanks : 0);
    settings.mutable_optimization()->set_micro_batches(count);
  }
  RankPlan plan;
  plan.set_settings(IdentifyingSettings(settings));
  plan.set_data_memory(latest && latest->data_memory() > 0 ? latest->data_memory()
                                                           : run.data_memory);
  return plan;
}

// Refuses a number of micro-batches that the ranks cannot divide.
absl::Status CheckMicroBatches(int micro_batches, int ranks) {
  if (ranks == 1 || (micro_batches > 0 && micro_batches % ranks == 0)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "optimization.micro_batches is ", micro_batches, ", which ", ranks,
      " ranks cannot divide; start a number of ranks that divides it, or begin anew with more"));
}

// All phases on loaded data.
class Training {
 public:
  // `ranks` must outlive the training.
  Training(const TrainingRun& run, at::Device device, RankGroup& ranks)
      : run_(run),
        device_(device),
        ranks_(ranks),
        settings_(run.settings),
        data_memory_(run.data_memory),
        progress_(Plan(run, {run.settings.examples().max_examples(),
                             run.settings.examples().max_examples(),
                             run.settings.examples().max_examples()}),
                  ranks.rank() == 0 ? run.progress : nullptr,
                  [] { return std::chrono::system_clock::now(); }) {}

  // Decides on rank 0 what the run leaves open, for all ranks. Call it first.
  absl::Status Agree() {
    RankPlan plan;
    absl::Status status = ranks_.OnRankZero([&] {
      const absl::StatusOr<RankPlan> made = PlanRun(run_);
      if (made.ok()) plan = *made;
      return made.status();
    });
    if (!status.ok()) return status;
    std::string bytes = plan.SerializeAsString();
    status = ranks_.Broadcast(&bytes);
    if (!status.ok()) return status;
    return ranks_.Apart([&] { return Adopt(bytes); });
  }

  absl::StatusOr<TrainingData> Load(const std::vector<std::filesystem::path>& datasets) {
    progress_.BeginPhase("load");
    absl::StatusOr<TrainingData> data;
    const absl::Status status = ranks_.Apart([&] {
      data = OpenTrainingData(datasets, settings_, data_memory_, Threads(run_),
                              [this] { return !ranks_.StopRequested(); });
      return data.status();
    });
    if (!status.ok()) return status;
    return data;
  }

  absl::StatusOr<v1::ModelManifest> Learn(const TrainingData& data) {
    progress_.Replan(Plan(run_, CountRunExamples(settings_.model(), data)));
    Learner learner(settings_, data, device_, Threads(run_), ranks_, progress_);
    std::optional<AnchorLearner> anchors;  // of rank 0, if the run has baselines
    GivenNames given{.labels = data.label_names};
    std::optional<CheckpointFolder> checkpoints;
    absl::Status status = ranks_.Apart([&] {
      if (!run_.start_from.empty()) {
        absl::StatusOr<GivenNames> started = Start(data, learner);
        if (!started.ok()) return started.status();
        given = *std::move(started);
      }
      if (ranks_.rank() != 0) return absl::OkStatus();
      if (!run_.checkpoints.empty()) {
        absl::StatusOr<CheckpointFolder> opened =
            CheckpointFolder::Open(run_.checkpoints, run_.checkpoint_policy);
        if (!opened.ok()) return opened.status();
        checkpoints = *std::move(opened);
        const absl::Status kept = learner.KeepCheckpoints(&*checkpoints);
        if (!kept.ok()) return kept;
      }
      if (run_.baselines) anchors.emplace(learner.state(), learner.loop());
      return absl::OkStatus();
    });
    if (status.ok()) {
      status = learner.Learn(Later(data, learner, anchors ? &*anchors : nullptr));
    }
    absl::StatusOr<v1::ModelManifest> manifest = v1::ModelManifest();
    if (status.ok()) {
      status = ranks_.OnRankZero([&] {
        manifest = Finish(data, learner, anchors ? &*anchors : nullptr, std::move(given));
        return manifest.status();
      });
    }
    if (status.ok()) return manifest;
    // Launchers kill the other ranks when one ends, so all wait for the checkpoint of rank 0.
    if (absl::IsCancelled(status)) ranks_.Apart([] { return absl::OkStatus(); }).IgnoreError();
    return status;
  }

 private:
  static std::vector<TrainingProgress::Phase> Plan(const TrainingRun& run,
                                                   const RunExamples& examples) {
    std::vector<TrainingProgress::Phase> plan =
        Learner::Plan(run.settings, examples, !run.start_from.empty());
    if (run.baselines) {
      AnchorLearner::AddPhases(run.settings, examples, &plan);
    }
    if (run.seconds_after > 0.0) {
      plan.push_back({"after", 1, 1, run.seconds_after / kSecondsPerCost, run.seconds_after});
    }
    return plan;
  }

  // Takes over rank 0's plan, if it is one for these settings.
  absl::Status Adopt(const std::string& bytes) {
    RankPlan plan;
    v1::TrainingSettings settings;
    if (!plan.ParseFromString(bytes) || !settings.ParseFromString(plan.settings())) {
      return absl::DataLossError("the data that rank 0 sent are damaged");
    }
    settings_.mutable_optimization()->set_micro_batches(settings.optimization().micro_batches());
    data_memory_ = plan.data_memory();
    if (IdentifyingSettings(settings_) != plan.settings()) {
      return absl::InvalidArgumentError(
          "settings: differ from those of rank 0; give all ranks the same");
    }
    return CheckMicroBatches(settings.optimization().micro_batches(), ranks_.size());
  }

  // Names that the actions have before anything is learned.
  struct GivenNames {
    std::vector<std::string> labels = {};   // of the first actions
    std::vector<std::string> derived = {};  // [K], or empty: they are still to be made
  };

  // Returns what follows the learner's phases.
  LaterPhases Later(const TrainingData& data, Learner& learner, const AnchorLearner* anchors) {
    LaterPhases later = anchors != nullptr ? anchors->Rehearsed() : LaterPhases();
    later.rehearse_others = [this, &data, &learner, anchors](MeasuredSteps* measured) {
      ExportOptions options;
      options.output = run_.output;
      options.threads = Threads(run_);
      if (anchors != nullptr) options.baselines = anchors->Export();
      options.progress = [this](int64_t, int64_t) { return !ranks_.StopRequested(); };
      const std::optional<ExportSeconds> seconds =
          RehearseExport({Describe(data), learner.state().networks.Export()}, data,
                         settings_.examples(), options, progress_.clock());
      if (!seconds) return;
      (*measured)[kExportPhase] = {seconds->write};
      (*measured)[kEvaluatePhase] = {seconds->measure / kEvaluateSteps, seconds->finish};
    };
    return later;
  }

  // Learns the baselines, if there is a learner of them, and writes the model.
  absl::StatusOr<v1::ModelManifest> Finish(const TrainingData& data, Learner& learner,
                                           AnchorLearner* anchors, GivenNames given) {
    ExportOptions options;
    if (anchors != nullptr) {
      absl::StatusOr<artifact::StoredBaselines> baselines = anchors->Learn();
      if (!baselines.ok()) return baselines.status();
      options.baselines = *std::move(baselines);
    }
    progress_.BeginPhase(kExportPhase);
    artifact::StoredModel model{Describe(data), learner.state().networks.Export()};
    options.output = run_.output;
    options.threads = Threads(run_);
    options.labels = std::move(given.labels);
    options.names = std::move(given.derived);
    options.least_effective_actions = run_.least_effective_actions;
    bool is_measuring = false;
    ExampleSteps measured(progress_, kEvaluateSteps);
    const auto begin_measuring = [this, &is_measuring] {
      if (!std::exchange(is_measuring, true)) progress_.BeginPhase(kEvaluatePhase);
    };
    options.progress = [this, &begin_measuring, &measured](int64_t done, int64_t total) {
      begin_measuring();
      measured.Reach(done, total);
      return !ranks_.StopRequested();
    };
    absl::StatusOr<v1::ModelManifest> manifest =
        ExportModel(std::move(model), data, settings_.examples(), options);
    if (!manifest.ok()) return manifest;
    begin_measuring();  // else there were too few examples for a report
    progress_.Step(0, {}, 1);
    return manifest;
  }

  // Gives the learner the model to start from. Returns the names of its actions, which stay what
  // they are.
  absl::StatusOr<GivenNames> Start(const TrainingData& data, Learner& learner) const {
    const absl::StatusOr<artifact::StoredModel> start = artifact::ReadModelFolder(run_.start_from);
    if (!start.ok()) return start.status();
    v1::ModelSpec spec = start->manifest.spec();
    spec.set_objective(run_.settings.model().objective());
    if (!google::protobuf::util::MessageDifferencer::Equals(spec, settings_.model())) {
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
    *manifest.mutable_spec() = settings_.model();
    *manifest.mutable_provenance() = MakeProvenance(settings_, data, run_.dataset_names,
                                                    run_.start_from_name, run_.trainer_version);
    return manifest;
  }

  const TrainingRun& run_;
  const at::Device device_;
  RankGroup& ranks_;
  v1::TrainingSettings settings_;
  int64_t data_memory_;
  TrainingProgress progress_;
};

// Runs `work` with LibTorch set up; its exceptions become a Status here and go no further.
absl::StatusOr<v1::ModelManifest> Guarded(
    const TrainingRun& run,
    const std::function<absl::StatusOr<v1::ModelManifest>(Training&)>& work) {
  return WithoutExceptions([&]() -> absl::StatusOr<v1::ModelManifest> {
    const absl::StatusOr<at::Device> device = FindDevice(run);
    if (!device.ok()) return device.status();
    at::set_num_threads(Threads(run));
    at::globalContext().setDeterministicAlgorithms(true, /*warn_only=*/true);
    const absl::StatusOr<std::unique_ptr<RankGroup>> ranks = RankGroup::Join(
        run.rank.value_or(RankPlace()), run.rank_timeout, run.rank_join_timeout,
        run.stopped ? run.stopped : [] { return false; });
    if (!ranks.ok()) return ranks.status();
    Training training(run, *device, **ranks);
    const absl::Status agreed = training.Agree();
    if (!agreed.ok()) return agreed;
    return work(training);
  });
}

}  // namespace

std::vector<std::string> UsableDevices() {
  if (at::hasCUDA()) return {"cpu", "cuda"};
  return {"cpu"};
}

void FlushDenormals() { at::globalContext().setFlushDenormal(true); }

absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run,
                                        const std::vector<std::filesystem::path>& datasets) {
  return Guarded(run, [&](Training& training) -> absl::StatusOr<v1::ModelManifest> {
    const absl::StatusOr<TrainingData> data = training.Load(datasets);
    if (!data.ok()) return data.status();
    return training.Learn(*data);
  });
}

absl::StatusOr<v1::ModelManifest> Train(const TrainingRun& run, const TrainingData& data) {
  return Guarded(run, [&](Training& training) { return training.Learn(data); });
}

}  // namespace maneuver::learning
