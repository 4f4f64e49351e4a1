#include "model/learning/export.h"

#include <algorithm>
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
#include "model/learning/training_failure.h"

namespace maneuver::learning {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kEnoughToTell = 100;  // examples: fewer may well be of one kind

// The first recordings that hold about kMostMeasured examples.
std::span<const v1::Scenario> Measured(const ExampleSet& set) {
  std::vector<int64_t> counts(set.recordings.size());
  for (const data::Example& example : set.examples) {
    ++counts[static_cast<size_t>(example.recording)];
  }
  int64_t examples = 0;
  size_t recordings = 0;
  while (recordings < counts.size() && examples < kMostMeasured) examples += counts[recordings++];
  return std::span(set.recordings).first(recordings);
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

// Metrics of the held-out recordings to the manifest; how the actions are used to *uses.
// FAILED_PRECONDITION if they are too few.
absl::Status Measure(const inference::ActionModel& model,
                     const inference::AnchorBaselines* baselines, const TrainingData& data,
                     const v1::ExampleSettings& examples, const ExportOptions& options,
                     v1::ModelManifest* manifest, std::vector<v1::ActionUse>* uses) {
  evaluation::EvaluationInput input;
  input.recordings = Measured(data.validation);
  input.annotations = data.annotations;
  input.examples = examples;
  input.baselines = baselines;
  input.threads = options.threads;
  input.progress = options.progress;
  const absl::StatusOr<v1::EvaluationReport> report = evaluation::Evaluate(model, input);
  if (absl::IsFailedPrecondition(report.status())) return absl::OkStatus();  // nothing to measure
  if (!report.ok()) return report.status();
  *manifest->mutable_metrics() = report->metrics();
  *manifest->mutable_rivals() = report->rivals();
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

}  // namespace

absl::StatusOr<v1::ModelManifest> ExportModel(artifact::StoredModel model, const TrainingData& data,
                                              const v1::ExampleSettings& examples,
                                              const ExportOptions& options) {
  absl::StatusOr<fs::path> temporary = files::MakeTemporaryFolderFor(options.output);
  if (!temporary.ok()) return temporary.status();
  const Scratch scratch(*temporary);
  const fs::path draft = scratch.folder() / "model";

  // Without held-out examples p(y) over the training examples stands in for usage, and nothing says
  // that an action is idle.
  std::vector<v1::ActionUse> uses;
  for (const float log_weight : model.weights.at("mixture.log_weight").values) {
    v1::ActionUse& use = uses.emplace_back();
    use.set_probability(std::exp(static_cast<double>(log_weight)));
    use.set_largest_probability(1.0);
  }
  absl::Status status = artifact::WriteModelFolder(draft, std::move(model));
  if (!status.ok()) return status;
  absl::StatusOr<std::shared_ptr<const inference::ActionModel>> loaded =
      inference::ActionModel::Load(draft, {inference::Precision::kF32});
  if (!loaded.ok()) return loaded.status();

  std::optional<inference::AnchorBaselines> baselines;
  if (options.baselines) {
    status = artifact::WriteBaselines(draft, *options.baselines);
    if (!status.ok()) return status;
    auto loaded_baselines = inference::LoadAnchorBaselines(draft, {inference::Precision::kF32});
    if (!loaded_baselines.ok()) return loaded_baselines.status();
    baselines = *std::move(loaded_baselines);
  }

  v1::ModelManifest manifest = (*loaded)->manifest();
  status = Measure(**loaded, baselines ? &*baselines : nullptr, data, examples, options, &manifest,
                   &uses);
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
       inference::DecodeActionSet(**loaded, usage, {effective.get(), uses.size()})) {
    const size_t k = static_cast<size_t>(action.action_id());
    if (k < options.labels.size()) action.set_label(options.labels[k]);
    *manifest.add_actions() = std::move(action);
  }
  const std::vector<std::string> names =
      options.names.empty() ? evaluation::NameActions(manifest, uses) : options.names;
  for (size_t k = 0; k < names.size(); ++k) {
    manifest.mutable_actions(static_cast<int>(k))->set_derived_name(names[k]);
  }
  status = artifact::RewriteModelManifest(draft, manifest);
  if (status.ok()) status = files::PublishFolder(draft, options.output);
  if (!status.ok()) return status;
  return manifest;
}

}  // namespace maneuver::learning
