#include "model/learning/cross_validation.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_blocks.h"
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

// The recordings of dataset folders, one folder after the other.
struct GroupedFolders {
  data::RecordingGroups groups;
  std::vector<size_t> ends;  // of each folder, in groups.ids
};

// Reads the folders as often as the hashes need that fit in the run's memory. All links count: folds
// must not share anything, however little it is.
absl::StatusOr<GroupedFolders> FindGroups(const CrossValidation& run,
                                          const std::vector<std::filesystem::path>& folders) {
  data::RecordingGrouper grouper(static_cast<size_t>(run.data_memory) / 2 /
                                 data::RecordingGrouper::kBytesPerHash);
  GroupedFolders grouped;
  do {
    grouped.ends.clear();
    size_t recordings = 0;
    for (const std::filesystem::path& folder : folders) {
      bool stopped = false;
      const absl::Status status =
          data::ForEachScenario(folder, data::OnDamage::kStop, [&](v1::Scenario&& recording) {
            grouper.Add(recording);
            ++recordings;
            stopped = run.stopped && run.stopped();
            return !stopped;
          });
      if (!status.ok()) return status;
      if (stopped) return Interrupted();
      grouped.ends.push_back(recordings);
    }
  } while (grouper.NextPass());
  grouped.groups = grouper.Groups();
  return grouped;
}

// Returns the annotations of the wanted recordings of a folder.
absl::StatusOr<std::vector<v1::ManeuverAnnotation>> ReadAnnotations(
    const std::filesystem::path& folder, const data::RecordingBlocks::Wanted& wanted) {
  std::vector<v1::ManeuverAnnotation> annotations;
  const absl::Status status = data::ForEachAnnotation(
      folder, data::OnDamage::kStop, [&](v1::ManeuverAnnotation&& annotation) {
        if (wanted(annotation.scenario_id())) annotations.push_back(std::move(annotation));
        return true;
      });
  if (!status.ok()) return status;
  return annotations;
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
  // Nothing for a recording that was added to a dataset after the plan was made: no fold learns from
  // it, and none measures it.
  std::optional<int> FoldOf(const std::string& scenario_id) const {
    const auto number = numbers_.find(scenario_id);
    if (number == numbers_.end()) return std::nullopt;
    return plan_.recordings(number->second).fold();
  }

  absl::Status Learn(const std::filesystem::path& output, v1::FoldRun& result) const {
    TrainingRun training;
    training.settings = run_.settings;
    training.settings.set_seed(result.seed());
    training.output = output;
    training.baselines = run_.baselines;
    training.data_memory = run_.data_memory;
    training.dataset_names = run_.dataset_names;
    training.trainer_version = run_.trainer_version;
    training.progress = run_.progress;
    training.stopped = run_.stopped;
    const absl::StatusOr<TrainingData> data = OpenTrainingData(
        run_.datasets, training.settings, run_.data_memory, Threads(), [this] { return GoesOn(); },
        [&](const std::string& id) {
          const std::optional<int> fold = FoldOf(id);
          return fold && *fold != result.fold();
        });
    if (!data.ok()) return data.status();
    NoteLearned(*data, result);
    return Train(training, *data).status();
  }

  // Notes what the data really hold, not what they were meant to.
  void NoteLearned(const TrainingData& data, v1::FoldRun& result) const {
    std::unordered_set<std::string> ids;
    for (const ExampleSet* side : {&data.training, &data.validation}) {
      for (const v1::Scenario& recording : side->recordings) ids.insert(recording.scenario_id());
    }
    if (data.windows) {
      for (const UnreadRecording& each : data.windows->recordings()) {
        ids.insert(data.windows->index(each.folder).entries()[each.index].scenario_id);
      }
    }
    for (int i = 0; i < plan_.recordings_size(); ++i) {
      if (ids.contains(plan_.recordings(i).scenario_id())) result.add_learned(i);
    }
    result.set_training_examples(data.TrainingExamples());
  }

  absl::Status Measure(const std::filesystem::path& folder, v1::FoldRun& result) const {
    const absl::StatusOr<LoadedModel> model = Load(folder);
    if (!model.ok()) return model.status();
    absl::StatusOr<v1::MeasuredSet> held_out =
        MeasureSet(*model, run_.datasets, plan_.recordings(), numbers_,
                   [&](const std::string& id) { return FoldOf(id) == result.fold(); });
    if (!held_out.ok()) return held_out.status();
    *result.mutable_held_out() = *std::move(held_out);
    for (int i = 0; i < plan_.test_datasets_size(); ++i) {
      const auto numbers = NumbersOf(plan_.test_datasets(i).recordings());
      absl::StatusOr<v1::MeasuredSet> test =
          MeasureSet(*model, {run_.test_datasets[static_cast<size_t>(i)].folder},
                     plan_.test_datasets(i).recordings(), numbers,
                     [&](const std::string& id) { return numbers.contains(id); });
      if (!test.ok()) return test.status();
      *result.add_tests() = *std::move(test);
    }
    return absl::OkStatus();
  }

  // Measures the wanted recordings of the folders block by block.
  //   recordings: as the plan has them
  //   numbers: of the recordings, in the plan
  absl::StatusOr<v1::MeasuredSet> MeasureSet(const LoadedModel& model,
                                             const std::vector<std::filesystem::path>& folders,
                                             const GroupedRecordings& recordings,
                                             const std::unordered_map<std::string, int>& numbers,
                                             const data::RecordingBlocks::Wanted& wanted) const {
    std::vector<v1::ManeuverAnnotation> annotations;
    for (const std::filesystem::path& folder : folders) {
      auto read = ReadAnnotations(folder, wanted);
      if (!read.ok()) return read.status();
      std::ranges::move(*read, std::back_inserter(annotations));
    }
    evaluation::EvaluationInput input;
    input.annotations = annotations;
    input.examples = run_.settings.examples();
    input.threads = Threads();
    if (model.baselines) input.baselines = &*model.baselines;
    input.progress = [this](int64_t, int64_t) { return GoesOn(); };
    evaluation::BlockMeasurer measurer(*model.model, input);
    std::vector<int> groups;
    for (const v1::GroupedRecording& recording : recordings) groups.push_back(recording.group());
    evaluation::MeasuredSetBuilder set(std::move(groups));
    const auto measure = [&](std::span<const v1::Scenario> block) {
      const absl::StatusOr<evaluation::MeasuredExamples> measured = measurer.Measure(block);
      if (!measured.ok()) return measured.status();
      std::vector<int> numbers_of_block;
      for (const v1::Scenario& recording : block) {
        numbers_of_block.push_back(numbers.at(recording.scenario_id()));
      }
      set.Add(*measured, numbers_of_block);
      return absl::OkStatus();
    };
    for (const std::filesystem::path& folder : folders) {
      const auto blocks = data::RecordingBlocks::Open(
          folder, run_.data_memory, [this] { return GoesOn(); }, wanted);
      if (!blocks.ok()) return blocks.status();
      absl::Status status = blocks->ForEach(measure);
      if (!status.ok()) return status;
    }
    if (absl::Status status = measurer.CheckExamples(); !status.ok()) return status;
    return std::move(set).Build();
  }

  bool GoesOn() const { return !run_.stopped || !run_.stopped(); }
  int Threads() const {
    return run_.settings.threads() > 0 ? run_.settings.threads() : machine::UsableCores();
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

  for (const std::filesystem::path& folder : run.datasets) {
    const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(folder);
    if (!manifest.ok()) return manifest.status();
    plan.add_dataset_sha256(data::ContentSha256(*manifest));
  }
  plan.mutable_dataset_names()->Add(run.dataset_names.begin(), run.dataset_names.end());
  const absl::StatusOr<GroupedFolders> learned_from = FindGroups(run, run.datasets);
  if (!learned_from.ok()) return learned_from.status();
  const data::RecordingGroups& groups = learned_from->groups;
  const absl::StatusOr<std::vector<int>> folds =
      data::AssignFolds(groups, run.folds, static_cast<uint64_t>(run.fold_seed));
  if (!folds.ok()) return folds.status();
  for (size_t i = 0; i < groups.ids.size(); ++i) {
    v1::GroupedRecording& recording = *plan.add_recordings();
    recording.set_scenario_id(groups.ids[i]);
    recording.set_group(groups.groups[i]);
    recording.set_fold(folds->at(i));
    recording.set_dataset(static_cast<int>(std::ranges::upper_bound(learned_from->ends, i) -
                                           learned_from->ends.begin()));
  }

  if (run.test_datasets.empty()) return plan;

  // Test recordings can link groups to learn from, which stay as they are.
  std::vector<std::filesystem::path> folders = run.datasets;
  for (const NamedDataset& test : run.test_datasets) folders.push_back(test.folder);
  const absl::StatusOr<GroupedFolders> all_folders = FindGroups(run, folders);
  if (!all_folders.ok()) return all_folders.status();
  const data::RecordingGroups& all = all_folders->groups;
  const std::span<const size_t> ends(
      all_folders->ends.begin() + static_cast<std::ptrdiff_t>(run.datasets.size()) - 1,
      all_folders->ends.end());
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
