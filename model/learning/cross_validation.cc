#include "model/learning/cross_validation.h"

#include <cstdint>
#include <map>
#include <memory>
#include <numeric>
#include <set>
#include <span>
#include <unordered_map>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/evaluator.h"
#include "model/evaluation/measured_set.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"
#include "model/learning/trainer.h"
#include "model/learning/training_data.h"
#include "model/machine/usable_cores.h"

namespace maneuver::learning {
namespace {

using GroupedRecordings = google::protobuf::RepeatedPtrField<v1::GroupedRecording>;

absl::Status Interrupted() { return absl::CancelledError("the cross-validation was stopped"); }

absl::Status AddRecordings(const CrossValidation& run, const std::filesystem::path& folder,
                           data::RecordingGrouper& grouper) {
  bool stopped = false;
  absl::Status status =
      data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
        grouper.Add(recording);
        stopped = run.stopped && run.stopped();
        return !stopped;
      });
  return stopped ? Interrupted() : status;
}

// Recordings of a dataset folder in memory.
struct RecordingsToMeasure {
  std::vector<v1::Scenario> scenarios;
  std::vector<int> numbers;  // of each, in the plan
  std::vector<v1::ManeuverAnnotation> annotations;
};

// Appends the recordings of a folder for which `number` returns one.
absl::Status ReadToMeasure(const std::filesystem::path& folder,
                           const std::function<std::optional<int>(const std::string& id)>& number,
                           RecordingsToMeasure& recordings) {
  std::set<std::string> ids;
  absl::Status status =
      data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
        if (const std::optional<int> found = number(recording.scenario_id())) {
          ids.insert(recording.scenario_id());
          recordings.numbers.push_back(*found);
          recordings.scenarios.push_back(std::move(recording));
        }
        return true;
      });
  if (!status.ok()) return status;
  return data::ForEachAnnotation(folder, data::OnDamage::kStop,
                                 [&](v1::ManeuverAnnotation&& annotation) {
                                   if (ids.contains(annotation.scenario_id())) {
                                     recordings.annotations.push_back(std::move(annotation));
                                   }
                                   return true;
                                 });
}

std::unordered_map<std::string, int> NumbersOf(const GroupedRecordings& recordings) {
  std::unordered_map<std::string, int> numbers;
  for (int i = 0; i < recordings.size(); ++i) {
    numbers.try_emplace(recordings[i].scenario_id(), i);
  }
  return numbers;
}

// A model as the engine has it, and its baselines if it has some.
struct LoadedModel {
  std::shared_ptr<const inference::ActionModel> model;
  std::optional<inference::AnchorBaselines> baselines;
};

absl::StatusOr<LoadedModel> Load(const std::filesystem::path& folder) {
  constexpr inference::Precision kPrecision = inference::Precision::kF32;
  LoadedModel loaded;
  auto model = inference::ActionModel::Load(folder, {kPrecision});
  if (!model.ok()) return model.status();
  loaded.model = *std::move(model);
  auto baselines = inference::LoadAnchorBaselines(folder, {kPrecision});
  if (baselines.ok()) {
    loaded.baselines = *std::move(baselines);
  } else if (!absl::IsNotFound(baselines.status())) {
    return baselines.status();
  }
  return loaded;
}

// Trains and measures one model after the other.
class FoldRunner {
 public:
  FoldRunner(const CrossValidation& run, const v1::CrossValidationPlan& plan)
      : run_(run), plan_(plan), numbers_(NumbersOf(plan.recordings())) {}

  absl::StatusOr<v1::FoldRun> Run(int64_t seed, int fold) const {
    v1::FoldRun result;
    result.set_seed(seed);
    result.set_fold(fold);
    const std::filesystem::path model =
        run_.models / absl::StrCat("seed-", seed, "-fold-", fold + 1);
    absl::Status status = Learn(model, result);
    if (status.ok()) status = Measure(model, result);
    if (!status.ok()) return status;
    return result;
  }

 private:
  int FoldOf(const std::string& scenario_id) const {
    return plan_.recordings(numbers_.at(scenario_id)).fold();
  }

  absl::Status Learn(const std::filesystem::path& output, v1::FoldRun& result) const {
    TrainingRun training;
    training.settings = run_.settings;
    training.settings.set_seed(result.seed());
    training.output = output;
    training.baselines = run_.baselines;
    for (const std::filesystem::path& folder : run_.datasets) {
      training.dataset_names.push_back(folder.filename().string());
    }
    training.trainer_version = run_.trainer_version;
    training.progress = run_.progress;
    training.stopped = run_.stopped;
    const absl::StatusOr<TrainingData> data = LoadTrainingData(
        run_.datasets, training.settings, [this] { return !run_.stopped || !run_.stopped(); },
        [&](const v1::Scenario& recording) {
          return FoldOf(recording.scenario_id()) != result.fold();
        });
    if (!data.ok()) return data.status();
    NoteLearned(*data, result);
    return Train(training, *data).status();
  }

  // Notes what the data really hold, not what they were meant to.
  void NoteLearned(const TrainingData& data, v1::FoldRun& result) const {
    std::set<std::string> ids;
    for (const ExampleSet* side : {&data.training, &data.validation}) {
      for (const v1::Scenario& recording : side->recordings) ids.insert(recording.scenario_id());
    }
    for (int i = 0; i < plan_.recordings_size(); ++i) {
      if (ids.contains(plan_.recordings(i).scenario_id())) result.add_learned(i);
    }
    result.set_training_examples(static_cast<int64_t>(data.training.examples.size()));
  }

  absl::Status Measure(const std::filesystem::path& folder, v1::FoldRun& result) const {
    const absl::StatusOr<LoadedModel> model = Load(folder);
    if (!model.ok()) return model.status();
    RecordingsToMeasure recordings;
    for (const std::filesystem::path& dataset : run_.datasets) {
      absl::Status status = ReadToMeasure(
          dataset,
          [&](const std::string& id) -> std::optional<int> {
            if (FoldOf(id) != result.fold()) return std::nullopt;
            return numbers_.at(id);
          },
          recordings);
      if (!status.ok()) return status;
    }
    absl::StatusOr<v1::MeasuredSet> held_out = MeasureSet(*model, recordings);
    if (!held_out.ok()) return held_out.status();
    *result.mutable_held_out() = *std::move(held_out);
    for (int i = 0; i < plan_.test_datasets_size(); ++i) {
      absl::StatusOr<v1::MeasuredSet> test = MeasureTest(*model, i);
      if (!test.ok()) return test.status();
      *result.add_tests() = *std::move(test);
    }
    return absl::OkStatus();
  }

  absl::StatusOr<v1::MeasuredSet> MeasureTest(const LoadedModel& model, int index) const {
    const auto numbers = NumbersOf(plan_.test_datasets(index).recordings());
    RecordingsToMeasure recordings;
    absl::Status status = ReadToMeasure(
        run_.test_datasets[static_cast<size_t>(index)].folder,
        [&](const std::string& id) -> std::optional<int> {
          const auto found = numbers.find(id);
          if (found == numbers.end()) return std::nullopt;
          return found->second;
        },
        recordings);
    if (!status.ok()) return status;
    return MeasureSet(model, recordings);
  }

  absl::StatusOr<v1::MeasuredSet> MeasureSet(const LoadedModel& model,
                                             const RecordingsToMeasure& recordings) const {
    evaluation::EvaluationInput input;
    input.recordings = recordings.scenarios;
    input.annotations = recordings.annotations;
    input.examples = run_.settings.examples();
    input.threads = run_.settings.threads() > 0 ? run_.settings.threads() : machine::UsableCores();
    if (model.baselines) input.baselines = &*model.baselines;
    input.progress = [this](int64_t, int64_t) { return !run_.stopped || !run_.stopped(); };
    const absl::StatusOr<evaluation::MeasuredExamples> measured =
        evaluation::MeasureExamples(*model.model, input);
    if (!measured.ok()) return measured.status();
    return evaluation::ToMeasuredSet(*measured, recordings.numbers);
  }

  const CrossValidation& run_;
  const v1::CrossValidationPlan& plan_;
  const std::unordered_map<std::string, int> numbers_;  // in the plan, by scenario id
};

// Adds the recordings begin .. end - 1 of `all` as a test dataset, without those of groups that are
// learned from.
absl::Status AddTestDataset(const std::string& name, const data::RecordingGroups& all, size_t begin,
                            size_t end, const std::set<int>& learned, int first_group,
                            v1::CrossValidationPlan& plan) {
  v1::TestDataset& dataset = *plan.add_test_datasets();
  dataset.set_name(name);
  for (size_t i = begin; i < end; ++i) {
    if (learned.contains(all.groups[i])) {
      dataset.set_left_out(dataset.left_out() + 1);
      continue;
    }
    v1::GroupedRecording& recording = *dataset.add_recordings();
    recording.set_scenario_id(all.ids[i]);
    recording.set_group(first_group + all.groups[i]);
  }
  if (!dataset.recordings().empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("every recording of the test dataset ", name,
                   " shares a place or an agent with the datasets to learn from"));
}

}  // namespace

absl::StatusOr<v1::CrossValidationPlan> PlanCrossValidation(const CrossValidation& run) {
  v1::CrossValidationPlan plan;
  *plan.mutable_settings() = run.settings;
  plan.mutable_settings()->clear_seed();
  plan.mutable_settings()->clear_threads();
  plan.mutable_settings()->set_baselines(run.baselines);
  plan.set_folds(run.folds);
  plan.set_fold_seed(run.fold_seed);
  plan.mutable_seeds()->Add(run.seeds.begin(), run.seeds.end());

  // Keeps all hashes: folds must not share anything, however little it is.
  data::RecordingGrouper grouper(SIZE_MAX);
  for (const std::filesystem::path& folder : run.datasets) {
    const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(folder);
    if (!manifest.ok()) return manifest.status();
    plan.add_dataset_sha256(data::ContentSha256(*manifest));
    if (absl::Status status = AddRecordings(run, folder, grouper); !status.ok()) return status;
  }
  const data::RecordingGroups groups = grouper.Groups();
  const absl::StatusOr<std::vector<int>> folds =
      data::AssignFolds(groups, run.folds, static_cast<uint64_t>(run.fold_seed));
  if (!folds.ok()) return folds.status();
  for (size_t i = 0; i < groups.ids.size(); ++i) {
    v1::GroupedRecording& recording = *plan.add_recordings();
    recording.set_scenario_id(groups.ids[i]);
    recording.set_group(groups.groups[i]);
    recording.set_fold(folds->at(i));
  }

  // Test recordings can link groups to learn from, which stay as they are.
  std::vector<size_t> ends = {groups.ids.size()};
  for (const NamedDataset& test : run.test_datasets) {
    absl::Status status = AddRecordings(run, test.folder, grouper);
    if (!status.ok()) return status;
    ends.push_back(grouper.Groups().ids.size());
  }
  const data::RecordingGroups all = grouper.Groups();
  const std::set<int> learned(all.groups.begin(),
                              all.groups.begin() + static_cast<std::ptrdiff_t>(ends.front()));
  for (size_t i = 0; i < run.test_datasets.size(); ++i) {
    const NamedDataset& test = run.test_datasets[i];
    const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(test.folder);
    if (!manifest.ok()) return manifest.status();
    absl::Status status =
        AddTestDataset(test.name, all, ends[i], ends[i + 1], learned, groups.count, plan);
    if (!status.ok()) return status;
    plan.mutable_test_datasets()->rbegin()->set_dataset_sha256(data::ContentSha256(*manifest));
  }
  return plan;
}

absl::StatusOr<v1::CrossValidationPart> CrossValidate(const CrossValidation& run,
                                                      const v1::CrossValidationPlan& plan) {
  const FoldRunner runner(run, plan);
  v1::CrossValidationPart part;
  *part.mutable_plan() = plan;
  for (const int64_t seed : run.seeds) {
    for (int fold = 0; fold < run.folds; ++fold) {
      if (run.only_fold && *run.only_fold != fold) continue;
      if (run.finished.contains({seed, fold})) continue;
      if (run.stopped && run.stopped()) return Interrupted();
      if (run.began) run.began(seed, fold);
      absl::StatusOr<v1::FoldRun> result = runner.Run(seed, fold);
      if (!result.ok()) {
        // The code and the payload tell how it failed; the message tells where.
        absl::Status status(result.status().code(),
                            absl::StrCat("seed ", seed, ", fold ", fold + 1, ": ",
                                         std::string(result.status().message())));
        result.status().ForEachPayload([&](absl::string_view url, const absl::Cord& payload) {
          status.SetPayload(url, payload);
        });
        return status;
      }
      if (run.measured) run.measured(*result);
      *part.add_runs() = *std::move(result);
    }
  }
  return part;
}

}  // namespace maneuver::learning
