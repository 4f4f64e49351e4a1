#include "model/learning/cross_validation.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/recording_blocks.h"
#include "model/evaluation/cross_validation_parts.h"
#include "model/evaluation/cross_validation_report.h"
#include "model/learning/training_data.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::cross_validation_test {
namespace {

using google::protobuf::util::MessageDifferencer;
using testing::HasSubstr;

// A recording moved by `x` metres along +x.
v1::Scenario Moved(v1::Scenario recording, const std::string& id, double x) {
  recording.set_scenario_id(id);
  for (v1::Agent& agent : *recording.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) state.set_x(state.x() + x);
  }
  for (v1::MapFeature& feature : *recording.mutable_map_features()) {
    for (double& point : *feature.mutable_x()) point += x;
  }
  return recording;
}

// `count` recordings, two at each place: drives on the same lane. Places are a kilometre apart,
// from `first_place` on; each place has a lane of its own.
std::vector<v1::Scenario> PairsOfDrives(int count, int first_place, const std::string& prefix) {
  const std::vector<v1::Scenario> arcs = ArcRecordings(2 * first_place + count);
  std::vector<v1::Scenario> recordings;
  for (int i = 0; i < count; ++i) {
    const int place = first_place + i / 2;
    recordings.push_back(Moved(arcs[static_cast<size_t>(2 * place + i % 2)],
                               prefix + std::to_string(i), 1000.0 * place));
    if (i % 2 == 1) {
      const size_t before = recordings.size() - 2;
      *recordings.back().mutable_map_features() = recordings[before].map_features();
    }
  }
  return recordings;
}

void WriteDataset(const std::filesystem::path& folder,
                  const std::vector<v1::Scenario>& recordings) {
  auto writer = data::DatasetWriter::Create(folder, "a test");
  ASSERT_TRUE(writer.ok());
  for (const v1::Scenario& recording : recordings) {
    ASSERT_TRUE((*writer)->Add(recording).ok());
  }
  ASSERT_TRUE((*writer)->Commit().ok());
}

class CrossValidationTest : public testing::Test {
 protected:
  static constexpr int kRecordings = 24;

  CrossValidationTest() {
    WriteDataset(folder_ / "drives", PairsOfDrives(kRecordings, 0, "drive-"));
    // The first two are at a place that models learn from.
    WriteDataset(folder_ / "others", PairsOfDrives(8, kRecordings / 2 - 1, "other-"));
    run_.settings = TinySettings();
    v1::OptimizationSettings& optimization = *run_.settings.mutable_optimization();
    optimization.set_pretraining_epochs(2);
    optimization.set_mixture_epochs(1);
    optimization.set_joint_epochs(1);
    optimization.set_posterior_epochs(1);
    run_.datasets = {folder_ / "drives"};
    run_.dataset_names = {"drives"};
    run_.folds = 2;
    run_.seeds = {7};
    run_.models = folder_ / "models";
    std::filesystem::create_directory(run_.models);
  }

  const TemporaryFolder folder_;
  CrossValidation run_;
};

TEST_F(CrossValidationTest, ThePlanSaysWhichDatasetEachRecordingIsOf) {
  run_.datasets = {folder_ / "drives", folder_ / "others"};
  run_.dataset_names = {"drives", "others"};
  const auto plan = PlanCrossValidation(run_);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_THAT(plan->dataset_names(), testing::ElementsAre("drives", "others"));
  ASSERT_EQ(plan->recordings_size(), kRecordings + 8);
  for (const v1::GroupedRecording& recording : plan->recordings()) {
    EXPECT_EQ(recording.dataset(), recording.scenario_id().starts_with("other-") ? 1 : 0);
  }
}

TEST_F(CrossValidationTest, MeasuresEachRecordingOnceByAModelThatNeverSawItsPlace) {
  run_.test_datasets = {{"others", folder_ / "others"}};
  const auto plan = PlanCrossValidation(run_);
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto part = CrossValidate(run_, *plan);
  ASSERT_TRUE(part.ok()) << part.status();

  ASSERT_EQ(plan->recordings_size(), kRecordings);
  std::map<std::string, int> measured_in;  // fold, by scenario id
  ASSERT_EQ(part->runs_size(), 2);
  for (const v1::FoldRun& run : part->runs()) {
    std::set<int> places;
    for (const int i : run.learned()) places.insert(i / 2);
    EXPECT_EQ(places.size(), static_cast<size_t>(run.learned_size()) / 2);
    EXPECT_EQ(run.learned_size(), kRecordings / 2);
    for (const v1::MeasuredExample& example : run.held_out().examples()) {
      EXPECT_FALSE(places.contains(example.recording() / 2));
      const std::string& id = plan->recordings(example.recording()).scenario_id();
      EXPECT_EQ(id, "drive-" + std::to_string(example.recording()));
      EXPECT_EQ(measured_in.try_emplace(id, run.fold()).first->second, run.fold());
    }
    // Each model is also measured on six of the other dataset's recordings.
    ASSERT_EQ(run.tests_size(), 1);
    std::set<int> others;
    for (const v1::MeasuredExample& example : run.tests(0).examples()) {
      others.insert(example.recording());
    }
    EXPECT_EQ(others.size(), 6u);
  }
  EXPECT_EQ(measured_in.size(), static_cast<size_t>(kRecordings));
  EXPECT_EQ(plan->test_datasets(0).left_out(), 2);
  EXPECT_EQ(plan->test_datasets(0).recordings(0).scenario_id(), "other-2");
  EXPECT_TRUE(std::filesystem::exists(run_.models / "seed-7-fold-1" / "model.json"));

  const auto whole = evaluation::MergeParts({*part});
  ASSERT_TRUE(whole.ok()) << whole.status();
  const auto report = evaluation::MakeCrossValidationReport(*whole, {.resamples = 100});
  EXPECT_EQ(report.sets(0).groups(), kRecordings / 2);
  EXPECT_EQ(report.sets(0).overall().groups(), kRecordings / 2);
  EXPECT_GT(report.sets(0).overall().metrics().at("ade_1").lower(), 0.0);
}

TEST_F(CrossValidationTest, MeasuresAtTheStrideWhateverTheTrainingStride) {
  run_.settings.mutable_optimization()->set_pretraining_epochs(1);
  run_.settings.mutable_optimization()->set_posterior_epochs(0);
  run_.only_fold = 0;
  const auto plan = PlanCrossValidation(run_);
  ASSERT_TRUE(plan.ok()) << plan.status();
  std::vector<std::set<std::pair<int, double>>> measured;  // recording and time
  std::vector<int64_t> learned;
  for (const bool denser : {false, true}) {
    if (denser) {
      run_.settings.mutable_examples()->mutable_training_stride()->set_nanos(200'000'000);
    }
    run_.models = folder_ / (denser ? "denser" : "models");
    std::filesystem::create_directories(run_.models);
    const auto part = CrossValidate(run_, *plan);
    ASSERT_TRUE(part.ok()) << part.status();
    ASSERT_EQ(part->runs_size(), 1);
    learned.push_back(part->runs(0).training_examples());
    auto& times = measured.emplace_back();
    for (const v1::MeasuredExample& example : part->runs(0).held_out().examples()) {
      times.emplace(example.recording(), example.time());
    }
  }
  EXPECT_GT(measured[0].size(), static_cast<size_t>(kRecordings));
  EXPECT_EQ(measured[0], measured[1]);
  EXPECT_GT(learned[1], 2 * learned[0]);
}

TEST_F(CrossValidationTest, SeparateFoldsMergeIntoTheResultOfOneRun) {
  const auto plan = PlanCrossValidation(run_);
  ASSERT_TRUE(plan.ok()) << plan.status();
  const auto together = CrossValidate(run_, *plan);
  ASSERT_TRUE(together.ok()) << together.status();
  std::filesystem::remove_all(run_.models);
  std::filesystem::create_directory(run_.models);
  std::vector<v1::CrossValidationPart> alone;
  for (const int fold : {1, 0}) {
    run_.only_fold = fold;
    const auto part = CrossValidate(run_, *PlanCrossValidation(run_));
    ASSERT_TRUE(part.ok()) << part.status();
    ASSERT_EQ(part->runs_size(), 1);
    alone.push_back(*part);
  }
  const auto merged = evaluation::MergeParts(alone);
  ASSERT_TRUE(merged.ok()) << merged.status();
  EXPECT_TRUE(MessageDifferencer::Equals(*merged, *evaluation::MergeParts({*together})));
}

TEST_F(CrossValidationTest, LearnsAndMeasuresPieceByPieceWhatDoesNotFit) {
  constexpr int kMany = 160;
  WriteDataset(folder_ / "many", PairsOfDrives(kMany, 0, "drive-"));
  run_.datasets = {folder_ / "many"};
  const auto plan = PlanCrossValidation(run_);
  ASSERT_TRUE(plan.ok()) << plan.status();

  // Four fifths of what one fold takes. The hashes of all recordings do not fit either.
  run_.data_memory = *data::RecordingBytes(folder_ / "many") * data::kMemoryPerByte * 2 / 5;
  const auto plan_again = PlanCrossValidation(run_);
  ASSERT_TRUE(plan_again.ok()) << plan_again.status();
  EXPECT_TRUE(MessageDifferencer::Equals(*plan_again, *plan));
  const auto part = CrossValidate(run_, *plan);
  ASSERT_TRUE(part.ok()) << part.status();
  std::set<int> measured;
  for (const v1::FoldRun& run : part->runs()) {
    const std::set<int> learned(run.learned().begin(), run.learned().end());
    EXPECT_GT(learned.size(), size_t{kMany / 3});  // many more than the sample
    for (const int i : learned) EXPECT_NE(plan->recordings(i).fold(), run.fold());
    for (const v1::MeasuredExample& example : run.held_out().examples()) {
      measured.insert(example.recording());
      EXPECT_EQ(plan->recordings(example.recording()).fold(), run.fold());
    }
  }
  EXPECT_EQ(measured.size(), size_t{kMany});
}

TEST_F(CrossValidationTest, MeasuresTheSameBlockByBlock) {
  // The datasets that a model learns from fit, and the test dataset does not.
  WriteDataset(folder_ / "many", PairsOfDrives(60, kRecordings / 2, "other-"));
  run_.test_datasets = {{"many", folder_ / "many"}};
  const auto whole = CrossValidate(run_, *PlanCrossValidation(run_));
  ASSERT_TRUE(whole.ok()) << whole.status();
  std::filesystem::remove_all(run_.models);
  std::filesystem::create_directory(run_.models);
  run_.data_memory = *data::RecordingBytes(folder_ / "drives") * data::kMemoryPerByte;
  const auto blocks = CrossValidate(run_, *PlanCrossValidation(run_));
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  EXPECT_TRUE(MessageDifferencer::Equals(*whole, *blocks));
}

TEST_F(CrossValidationTest, TestDatasetsDoNotChangeTheFolds) {
  const auto alone = PlanCrossValidation(run_);
  run_.test_datasets = {{"others", folder_ / "others"}};
  const auto beside = PlanCrossValidation(run_);
  ASSERT_TRUE(alone.ok() && beside.ok());
  for (int i = 0; i < kRecordings; ++i) {
    EXPECT_TRUE(MessageDifferencer::Equals(alone->recordings(i), beside->recordings(i))) << i;
  }
}

TEST_F(CrossValidationTest, LeavesOutARecordingThatWasAddedAfterThePlan) {
  const v1::CrossValidationPlan plan = *PlanCrossValidation(run_);
  const auto before = CrossValidate(run_, plan);
  ASSERT_TRUE(before.ok()) << before.status();
  std::filesystem::remove_all(run_.models);
  std::filesystem::create_directory(run_.models);
  std::vector<v1::Scenario> more = PairsOfDrives(kRecordings, 0, "drive-");
  more.push_back(PairsOfDrives(1, kRecordings, "added-")[0]);
  std::filesystem::remove_all(folder_ / "drives");
  WriteDataset(folder_ / "drives", more);
  const auto after = CrossValidate(run_, plan);
  ASSERT_TRUE(after.ok()) << after.status();
  EXPECT_TRUE(MessageDifferencer::Equals(*after, *before));
}

TEST_F(CrossValidationTest, RefusesATestDatasetThatIsAlsoATrainingDataset) {
  run_.test_datasets = {{"again", folder_ / "drives"}};
  const absl::Status status = PlanCrossValidation(run_).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("test dataset again"));
}

TEST_F(CrossValidationTest, NamesTheFoldThatFailedAndStopsWhenAsked) {
  run_.settings.mutable_optimization()->set_batch_size(500);
  absl::Status status = CrossValidate(run_, *PlanCrossValidation(run_)).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("seed 7, fold 1: "));
  run_.settings.mutable_optimization()->set_batch_size(16);
  const v1::CrossValidationPlan plan = *PlanCrossValidation(run_);
  run_.stopped = [] { return true; };
  EXPECT_EQ(CrossValidate(run_, plan).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(PlanCrossValidation(run_).status().code(), absl::StatusCode::kCancelled);
}

TEST(LoadTrainingDataTest, LabelsOfExcludedRecordingsAreNotUsed) {
  const TemporaryFolder folder;
  auto writer = data::DatasetWriter::Create(folder / "arcs", "a test");
  const std::vector<v1::Scenario> recordings = ArcRecordings(40);
  for (size_t i = 0; i < recordings.size(); ++i) {
    ASSERT_TRUE((*writer)->Add(recordings[i]).ok());
    v1::ManeuverAnnotation annotation;
    annotation.set_scenario_id(recordings[i].scenario_id());
    annotation.set_agent_id(1);
    annotation.set_end_time(8.0);
    annotation.set_maneuver(i % 2 == 0 ? "even" : "odd");
    ASSERT_TRUE((*writer)->Add(annotation).ok());
  }
  ASSERT_TRUE((*writer)->Commit().ok());
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_examples()->set_label_share(1.0);
  int met = 0;
  const std::vector<std::filesystem::path> folders = {folder / "arcs"};
  const auto data = LoadTrainingData(
      folders, settings, [] { return true; }, [&](const std::string&) { return met++ % 2 == 0; });
  ASSERT_TRUE(data.ok()) << data.status();
  EXPECT_EQ(data->training.recordings.size() + data->validation.recordings.size(), 20u);
  EXPECT_THAT(data->label_names, testing::ElementsAre("even"));
  for (const v1::ManeuverAnnotation& annotation : data->annotations) {
    EXPECT_EQ(annotation.maneuver(), "even");
  }
}

}  // namespace
}  // namespace maneuver::learning::cross_validation_test
