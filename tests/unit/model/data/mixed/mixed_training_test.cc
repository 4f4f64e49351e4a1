// One model learned from imported recordings of two formats: weights, labels and held-out recordings
// hold for each of them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/data/argoverse/argoverse_reader.h"
#include "model/data/dataset_folder.h"
#include "model/data/label_file.h"
#include "model/data/nuscenes/nuscenes_scene.h"
#include "model/data/nuscenes/nuscenes_tables.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"
#include "model/learning/recording_windows.h"
#include "model/learning/trainer.h"
#include "model/learning/training_data.h"
#include "tests/unit/model/data/argoverse/argoverse_fixture.h"
#include "tests/unit/model/data/nuscenes/nuscenes_fixture.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::mixed_training_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;

constexpr int kScenes = 16;     // of nuScenes
constexpr int kSequences = 24;  // of Argoverse

class MixedTrainingTest : public testing::Test {
 protected:
  // Imports both formats, each into a dataset of its own, with a label in each recording.
  MixedTrainingTest() {
    const data::NuScenesFixture fixture(kScenes, 13);  // 6 s
    fixture.Write(folder_ / "tables");
    const auto scenes = data::ReadNuScenes(
        fixture.Tables(folder_ / "tables"), [](const absl::Status& damage) { return damage; },
        [](double) {});
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    std::vector<v1::Scenario> recordings;
    std::string labels = "recording,target,time,action\n";
    for (const data::NuScenesScene& scene : *scenes) {
      recordings.push_back(*ScenarioOf(scene, nullptr));
      const std::string& id = recordings.back().scenario_id();
      const std::string name = id.substr(id.find('#') + 1);
      absl::StrAppend(&labels, id, ",", data::AgentId(data::NuScenesFixture::Token(name + "/car")),
                      ",2.0,keep_lane\n");
    }
    WriteLabelled("nuscenes", recordings, labels);

    recordings.clear();
    labels = "recording,target,time,action\n";
    for (int i = 0; i < kSequences; ++i) {
      recordings.push_back(*data::ParseArgoverse(data::ArgoverseSequence(600'000.0 + 200.0 * i),
                                                 absl::StrCat(i), nullptr));
      absl::StrAppend(&labels, recordings.back().scenario_id(), ",", data::AgentId("agent"),
                      ",1.5,slow_down\n");
    }
    WriteLabelled("argoverse", recordings, labels);

    settings_ = TinySettings();
    v1::ExampleSettings& examples = *settings_.mutable_examples();
    examples.set_keep_standing(1.0);
    examples.set_label_share(1.0);
    examples.set_validation_share(0.4);
    examples.add_dataset_weights(1.0);
    examples.add_dataset_weights(3.0);
  }

  void WriteLabelled(const std::string& name, const std::vector<v1::Scenario>& recordings,
                     const std::string& labels) {
    const fs::path unlabelled = folder_ / ("unlabelled-" + name);
    auto writer = data::DatasetWriter::Create(unlabelled, "a test");
    for (const v1::Scenario& recording : recordings) {
      EXPECT_TRUE((*writer)->Add(recording).ok());
      const bool held_out = data::HeldOut(recording.scenario_id(), 0.4);
      (held_out ? held_out_ : learned_)[folders_.size()].insert(recording.scenario_id());
    }
    EXPECT_TRUE((*writer)->Commit().ok());
    const auto checked = data::CheckLabels(labels, unlabelled);
    ASSERT_TRUE(checked.ok()) << checked.status();
    ASSERT_EQ(checked->problem_count, 0) << checked->problems[0].what;
    folders_.push_back(folder_ / name);
    ASSERT_TRUE(data::AnnotateDataset(unlabelled, checked->annotations, folders_.back()).ok());
  }

  static bool KeepGoing() { return true; }

  const TemporaryFolder folder_;
  std::vector<fs::path> folders_;  // nuScenes, Argoverse
  // Ids of the recordings of each folder.
  std::array<std::set<std::string>, 2> learned_, held_out_;
  v1::TrainingSettings settings_;
};

TEST_F(MixedTrainingTest, EachFormatGivesExamplesLabelsAndHeldOutRecordings) {
  const auto data = LoadTrainingData(folders_, settings_, KeepGoing);
  ASSERT_TRUE(data.ok()) << data.status();
  // An example needs half a second before it and three after it. Of each scene of 6 s, three vehicles
  // give six; of each sequence of 4.9 s, two give three.
  EXPECT_THAT(data->folder_examples, ElementsAre(18 * static_cast<int64_t>(learned_[0].size()),
                                                 6 * static_cast<int64_t>(learned_[1].size())));
  std::set<std::string> held_out;
  for (const v1::Scenario& recording : data->validation.recordings) {
    held_out.insert(recording.scenario_id());
  }
  EXPECT_FALSE(held_out_[0].empty() || held_out_[1].empty());
  std::set<std::string> expected = held_out_[0];
  expected.insert(held_out_[1].begin(), held_out_[1].end());
  EXPECT_EQ(held_out, expected);

  // One label in each recording; those of held-out recordings are for evaluation alone.
  EXPECT_THAT(data->label_names, ElementsAre("keep_lane", "slow_down"));
  EXPECT_EQ(std::ranges::count(data->labels, 0), static_cast<int64_t>(learned_[0].size()));
  EXPECT_EQ(std::ranges::count(data->labels, 1), static_cast<int64_t>(learned_[1].size()));
  EXPECT_EQ(data->annotations.size(), held_out.size());
}

TEST_F(MixedTrainingTest, AnEpochTakesExamplesOfEachFormatByItsWeight) {
  const auto windows = RecordingWindows::Open(folders_, settings_, 1 << 20, 1, KeepGoing);
  ASSERT_TRUE(windows.ok()) << windows.status();
  std::array<int64_t, 2> examples = {};
  for (const EpochWindow& window : (*windows)->Plan(400, 0)) {
    for (const size_t i : window.recordings) {
      const UnreadRecording& recording = (*windows)->recordings()[i];
      examples[static_cast<size_t>(recording.folder)] += recording.examples;
    }
  }
  EXPECT_GT(examples[0], 1000);
  EXPECT_NEAR(static_cast<double>(examples[1]) / static_cast<double>(examples[0]), 3.0, 0.1);
}

TEST_F(MixedTrainingTest, OneModelLearnsFromBothAndNamesItsActionsByTheirLabels) {
  TrainingRun run;
  run.settings = settings_;
  v1::OptimizationSettings& optimization = *run.settings.mutable_optimization();
  optimization.set_pretraining_epochs(2);
  optimization.set_mixture_epochs(1);
  optimization.set_joint_epochs(2);
  optimization.set_posterior_epochs(1);
  run.output = folder_ / "model";
  run.dataset_names = {"nuscenes", "argoverse"};
  const auto manifest = Train(run, folders_);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_EQ(manifest->provenance().training_examples(),
            static_cast<int64_t>(18 * learned_[0].size() + 6 * learned_[1].size()));
  EXPECT_EQ(manifest->provenance().validation_examples(),
            static_cast<int64_t>(18 * held_out_[0].size() + 6 * held_out_[1].size()));
  EXPECT_THAT(manifest->provenance().datasets(), ElementsAre("nuscenes", "argoverse"));
  EXPECT_EQ(manifest->actions(0).label(), "keep_lane");
  EXPECT_EQ(manifest->actions(1).label(), "slow_down");
}

}  // namespace
}  // namespace maneuver::learning::mixed_training_test
