#include "model/learning/export.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/evaluation/action_names.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/evaluator.h"
#include "model/files/durable_file.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"
#include "model/learning/measured_recordings.h"
#include "model/learning/measuring_time.h"
#include "model/learning/training_failure.h"

namespace maneuver::learning {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kEnoughToTell = 100;     // examples: fewer may well be of one kind
constexpr int64_t kOneRehearsedIn = 10;    // examples, of which one is in a rehearsal
constexpr int64_t kFewestRehearsed = 256;  // examples: four reports of evaluation::Evaluate

std::vector<v1::Scenario> Copy(const ExampleSet& set, const MeasuredRecordings& chosen) {
  std::vector<v1::Scenario> recordings;
  recordings.reserve(chosen.indices.size());
  for (const size_t i : chosen.indices) recordings.push_back(set.recordings[i]);
  return recordings;
}

// Removes a folder of work in progress, whatever happens.
class Scratch {
 public:
  explicit Scratch(fs::path folder) : folder_(std::move(folder)) {}
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  const fs::path& folder() const { return folder_; }

 private:
  fs::path folder_;
};

bool IsEffective(const v1::ActionUse& use) {
  return use.largest_probability() >= evaluation::ActionStatistics::kEffectiveProbability;
}

// A model folder in work, and what the engine has loaded from it.
struct Draft {
  explicit Draft(fs::path temporary)
      : scratch(std::move(temporary)), folder(scratch.folder() / "model") {}

  const Scratch scratch;
  const fs::path folder;
  std::vector<double> usage;  // p(y) over the training examples
  std::shared_ptr<const inference::ActionModel> model;
  std::optional<inference::AnchorBaselines> baselines;
};

absl::StatusOr<std::unique_ptr<Draft>> WriteDraft(artifact::StoredModel model,
                                                  const ExportOptions& options) {
  absl::StatusOr<fs::path> temporary = files::MakeTemporaryFolderFor(options.output);
  if (!temporary.ok()) return temporary.status();
  auto draft = std::make_unique<Draft>(*std::move(temporary));
  for (const float log_weight : model.weights.at("mixture.log_weight").values) {
    draft->usage.push_back(std::exp(static_cast<double>(log_weight)));
  }
  absl::Status status = artifact::WriteModelFolder(draft->folder, std::move(model));
  if (!status.ok()) return status;
  absl::StatusOr<std::shared_ptr<const inference::ActionModel>> loaded =
      inference::ActionModel::Load(draft->folder, {inference::Precision::kF32});
  if (!loaded.ok()) return loaded.status();
  draft->model = *std::move(loaded);
  if (options.baselines) {
    status = artifact::WriteBaselines(draft->folder, *options.baselines);
    if (!status.ok()) return status;
    auto baselines = inference::LoadAnchorBaselines(draft->folder, {inference::Precision::kF32});
    if (!baselines.ok()) return baselines.status();
    draft->baselines = *std::move(baselines);
  }
  return draft;
}

// Measures the model on recordings. Adds its metrics to the manifest and sets how the actions are
// used. FAILED_PRECONDITION if too few are effective.
absl::Status Measure(const Draft& draft, std::span<const v1::Scenario> recordings,
                     const TrainingData& data, const v1::ExampleSettings& examples,
                     const ExportOptions& options, v1::ModelManifest* manifest,
                     std::vector<v1::ActionUse>* uses) {
  evaluation::EvaluationInput input;
  input.recordings = recordings;
  input.annotations = data.annotations;
  input.examples = examples;
  if (draft.baselines) input.baselines = &*draft.baselines;
  input.threads = options.threads;
  input.progress = options.progress;
  const absl::StatusOr<v1::EvaluationReport> report = evaluation::Evaluate(*draft.model, input);
  if (absl::IsFailedPrecondition(report.status())) return absl::OkStatus();  // nothing to measure
  if (!report.ok()) return report.status();
  *manifest->mutable_metrics() = report->metrics();
  *manifest->mutable_rivals() = report->rivals();
  // A recalibration learns no new scenes: its uses and its ranges are those of its model.
  if (options.uses.empty()) *manifest->mutable_input_ranges() = report->input_ranges();
  uses->assign(report->action_uses().begin(), report->action_uses().end());
  if (report->examples() < kEnoughToTell) return absl::OkStatus();
  const auto effective = std::count_if(uses->begin(), uses->end(), IsEffective);
  if (effective >= options.least_effective_actions) return absl::OkStatus();
  return WithFailure(absl::FailedPreconditionError(absl::StrCat(
                         "the model collapsed to ", effective, " of ", uses->size(),
                         " actions over ", report->examples(),
                         " held-out examples; use another mixture_placement or seed, a longer "
                         "pretraining, or more and more varied recordings")),
                     TrainingFailure::kCollapsed);
}

// Measures the model of the draft on recordings, describes its actions and completes its manifest.
absl::StatusOr<v1::ModelManifest> Complete(const Draft& draft,
                                           std::span<const v1::Scenario> recordings,
                                           const TrainingData& data,
                                           const v1::ExampleSettings& examples,
                                           const ExportOptions& options) {
  v1::ModelManifest manifest = draft.model->manifest();
  // Without held-out examples p(y) over the training examples stands in for usage, and nothing says
  // that an action is idle.
  std::vector<v1::ActionUse> uses;
  for (const double probability : draft.usage) {
    v1::ActionUse& use = uses.emplace_back();
    use.set_probability(probability);
    use.set_largest_probability(1.0);
  }
  absl::Status status = Measure(draft, recordings, data, examples, options, &manifest, &uses);
  if (!status.ok()) return status;
  if (!options.uses.empty()) uses = options.uses;
  std::vector<double> usage;
  const std::unique_ptr<bool[]> effective(
      new bool[uses.size()]);  // std::vector<bool> is not an array
  for (size_t k = 0; k < uses.size(); ++k) {
    usage.push_back(uses[k].probability());
    effective[k] = IsEffective(uses[k]);
  }
  for (v1::Action& action :
       inference::DecodeActionSet(*draft.model, usage, {effective.get(), uses.size()})) {
    const size_t k = static_cast<size_t>(action.action_id());
    if (k < options.labels.size()) action.set_label(options.labels[k]);
    *manifest.add_actions() = std::move(action);
  }
  const std::vector<std::string> names =
      options.names.empty() ? evaluation::NameActions(manifest, uses) : options.names;
  for (size_t k = 0; k < names.size(); ++k) {
    manifest.mutable_actions(static_cast<int>(k))->set_derived_name(names[k]);
  }
  status = artifact::RewriteModelManifest(draft.folder, manifest);
  if (!status.ok()) return status;
  return manifest;
}

}  // namespace

absl::StatusOr<v1::ModelManifest> ExportModel(artifact::StoredModel model, const TrainingData& data,
                                              const v1::ExampleSettings& examples,
                                              const ExportOptions& options) {
  const absl::StatusOr<std::unique_ptr<Draft>> draft = WriteDraft(std::move(model), options);
  if (!draft.ok()) return draft.status();
  absl::StatusOr<v1::ModelManifest> manifest =
      Complete(**draft, Copy(data.validation, ChooseRecordings(data.validation, kMostMeasured)),
               data, examples, options);
  if (!manifest.ok()) return manifest;
  const absl::Status status = files::PublishFolder((*draft)->folder, options.output);
  if (!status.ok()) return status;
  return manifest;
}

std::optional<ExportSeconds> RehearseExport(artifact::StoredModel model, const TrainingData& data,
                                            const v1::ExampleSettings& examples,
                                            const ExportOptions& options,
                                            const TrainingProgress::Clock& clock) {
  const int64_t all = ChooseRecordings(data.validation, kMostMeasured).examples;
  const MeasuredRecordings chosen =
      ChooseRecordings(data.validation, std::max(kFewestRehearsed, all / kOneRehearsedIn));
  if (chosen.examples < kFewestRehearsed) return std::nullopt;
  const std::vector<v1::Scenario> few = Copy(data.validation, chosen);
  const auto begun = clock();
  const absl::StatusOr<std::unique_ptr<Draft>> draft = WriteDraft(std::move(model), options);
  if (!draft.ok()) return std::nullopt;
  const auto written = clock();
  MeasuringTime time(clock);
  ExportOptions rehearsed = options;
  rehearsed.least_effective_actions = 0;  // the model has not learned
  rehearsed.progress = [&](int64_t done, int64_t total) {
    time.Continue(done, total);
    return !options.progress || options.progress(done, total);
  };
  if (!Complete(**draft, few, data, examples, rehearsed).ok()) return std::nullopt;
  const auto seconds = [](auto duration) {
    return std::chrono::duration<double>(duration).count();
  };
  const double finished = seconds(clock() - written);
  const std::optional<double> prepare = time.SecondsOf(0);
  if (!prepare) return std::nullopt;
  return ExportSeconds{seconds(written - begun) + *prepare, *time.SecondsOf(all) - *prepare,
                       std::max(0.0, finished - *time.Seconds())};
}

}  // namespace maneuver::learning
