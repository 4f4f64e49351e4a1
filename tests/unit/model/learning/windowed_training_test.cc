// Learning from more recordings than fit in memory.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/recording_blocks.h"
#include "model/data/recording_split.h"
#include "model/files/durable_file.h"
#include "model/learning/recording_windows.h"
#include "model/learning/scene_loader.h"
#include "model/learning/trainer.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::windowed_training_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

bool KeepGoing() { return true; }

class WindowedTrainingTest : public testing::Test {
 protected:
  // Writes 240 recordings. Every third one is labelled "training"; held-out ones "held_out".
  WindowedTrainingTest() {
    auto writer = data::DatasetWriter::Create(folders_[0], "test", {.shard_bytes = 100'000});
    int number = 0;
    for (const v1::Scenario& recording : ArcRecordings(240)) {
      EXPECT_TRUE((*writer)->Add(recording).ok());
      const bool held_out =
          data::HeldOut(recording.scenario_id(), TinySettings().examples().validation_share());
      if (!held_out && number++ % 3 != 0) continue;
      v1::ManeuverAnnotation annotation;
      annotation.set_scenario_id(recording.scenario_id());
      annotation.set_agent_id(recording.agents(0).id());
      annotation.set_start_time(0.0);
      annotation.set_end_time(100.0);
      annotation.set_maneuver(held_out ? "held_out" : "training");
      EXPECT_TRUE((*writer)->Add(annotation).ok());
    }
    EXPECT_TRUE((*writer)->Commit().ok());
    bytes_ = *data::RecordingBytes(folders_[0]);
  }

  TrainingRun Run(const std::string& name) const {
    TrainingRun run;
    run.settings = TinySettings();
    run.settings.mutable_optimization()->set_pretraining_epochs(4);
    run.settings.mutable_optimization()->set_mixture_epochs(2);
    run.settings.mutable_optimization()->set_joint_epochs(2);
    run.output = folder_ / name;
    run.data_memory = Small();
    return run;
  }

  // Memory of which a window holds a fifth of the recordings.
  int64_t Small() const { return bytes_ * data::kMemoryPerByte * 4 / 5; }

  absl::StatusOr<TrainingData> OpenSmall(const v1::TrainingSettings& settings) const {
    return OpenTrainingData(folders_, settings, Small(), 2, KeepGoing);
  }
  static std::vector<EpochWindow> PlanFirstEpoch(const TrainingData& data,
                                                 const v1::TrainingSettings& settings) {
    return data.windows->Plan(data.TrainingExamples() / settings.optimization().batch_size(), 0);
  }

  std::string Weights(const std::string& name) const {
    return *files::ReadFile(folder_ / name / "weights.safetensors");
  }

  const TemporaryFolder folder_;
  const std::vector<fs::path> folders_ = {folder_ / "arcs"};
  int64_t bytes_ = 0;
};

TEST_F(WindowedTrainingTest, CountsTheExamplesThatAPassOverAllFinds) {
  const TrainingRun run = Run("model");
  const auto all = LoadTrainingData(folders_, run.settings, KeepGoing);
  // They are counted, then read back, and then counted again because the file is damaged.
  for (int i = 0; i < 3; ++i) {
    const auto large = OpenSmall(run.settings);
    ASSERT_TRUE(large.ok()) << large.status();
    EXPECT_EQ(large->TrainingExamples(), static_cast<int64_t>(all->training.examples.size()));
    int files = 0;
    for (const auto& entry : fs::directory_iterator(folders_[0])) {
      if (!entry.path().filename().string().starts_with(".examples-")) continue;
      ++files;
      if (i == 1) std::fstream(entry.path(), std::ios::in | std::ios::out).seekp(9).write("x", 1);
    }
    EXPECT_EQ(files, 1);
  }
}

TEST(WindowItemsTest, SeedsShareNoOrder) {
  const auto order = [](int64_t seed, int epoch) {
    v1::TrainingSettings settings = TinySettings();
    settings.set_seed(seed);
    EpochWindow window;
    window.steps = 4;
    std::vector<int64_t> examples;
    for (const SceneLoader::Item& item : WindowItems(settings, 100, window, 0, epoch)) {
      examples.push_back(item.example);
    }
    return examples;
  };
  EXPECT_EQ(order(1, 2), order(1, 2));
  EXPECT_NE(order(1, 2), order(2, 1));
}

TEST_F(WindowedTrainingTest, FindsTheExamplesOfTheTrainingStride) {
  v1::TrainingSettings settings = Run("model").settings;
  std::vector<int64_t> counts;
  // Counts of one stride are kept beside the dataset; those of another are counted anew.
  for (const int milliseconds : {500, 200, 500}) {
    settings.mutable_examples()->mutable_training_stride()->set_nanos(1'000'000 * milliseconds);
    const auto all = LoadTrainingData(folders_, settings, KeepGoing);
    const auto large = OpenSmall(settings);
    ASSERT_TRUE(large.ok()) << large.status();
    EXPECT_EQ(large->TrainingExamples(), static_cast<int64_t>(all->training.examples.size()));
    counts.push_back(large->TrainingExamples());
    // Reading a window finds what was counted.
    const auto loaded = large->windows->Load(PlanFirstEpoch(*large, settings)[0], KeepGoing);
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    for (const data::Example& example : large->validation.examples) {
      EXPECT_NEAR(std::remainder(example.time, 0.5), 0.0, 1e-6);
    }
  }
  EXPECT_EQ(counts[0], counts[2]);
  EXPECT_GT(counts[1], 2 * counts[0]);
}

TEST_F(WindowedTrainingTest, KeepsASampleOfBothSidesInMemory) {
  const TrainingRun run = Run("model");
  const auto all = LoadTrainingData(folders_, run.settings, KeepGoing);
  const auto large = OpenSmall(run.settings);
  ASSERT_TRUE(large.ok()) << large.status();
  // A quarter of the memory and an eighth of it, in which a fifth and a tenth of the recordings fit.
  const auto ratio = [](const ExampleSet& set, size_t recordings) {
    return static_cast<double>(set.recordings.size()) / static_cast<double>(recordings);
  };
  EXPECT_NEAR(ratio(large->training, 240), 0.2, 0.02);
  EXPECT_NEAR(ratio(large->validation, 240), 0.1, 0.02);
  const double share = run.settings.examples().validation_share();
  for (const v1::Scenario& recording : large->validation.recordings) {
    EXPECT_TRUE(data::HeldOut(recording.scenario_id(), share));
  }
  for (const v1::Scenario& recording : large->training.recordings) {
    EXPECT_FALSE(data::HeldOut(recording.scenario_id(), share));
  }
  EXPECT_EQ(large->annotations.size(), large->validation.recordings.size());
}

TEST_F(WindowedTrainingTest, ReadsEveryTrainingRecordingOfAnEpochWithItsLabels) {
  TrainingRun run = Run("model");
  run.settings.mutable_examples()->set_label_share(0.5);
  const auto all = LoadTrainingData(folders_, run.settings, KeepGoing);
  ASSERT_TRUE(all.ok()) << all.status();
  using Key = std::tuple<std::string, int64_t, double>;
  const auto key = [](const ExampleSet& set, size_t i) {
    const data::Example& example = set.examples[i];
    return Key(set.recordings[static_cast<size_t>(example.recording)].scenario_id(),
               example.target_id, example.time);
  };
  std::map<Key, int> labels;
  for (size_t i = 0; i < all->labels.size(); ++i) labels[key(all->training, i)] = all->labels[i];

  const auto large = OpenSmall(run.settings);
  ASSERT_TRUE(large.ok()) << large.status();
  EXPECT_THAT(large->label_names, ElementsAre("training"));
  const std::vector<EpochWindow> windows = PlanFirstEpoch(*large, run.settings);
  EXPECT_GE(windows.size(), 4u);
  std::set<std::string> ids;
  for (const EpochWindow& window : windows) {
    const auto loaded = large->windows->Load(window, KeepGoing);
    ASSERT_TRUE(loaded.ok()) << loaded.status();
    const auto examples = static_cast<int64_t>(loaded->set.examples.size());
    EXPECT_GE(examples, window.steps * run.settings.optimization().batch_size());
    ASSERT_EQ(loaded->labels.size(), loaded->set.examples.size());
    for (size_t i = 0; i < loaded->labels.size(); ++i) {
      EXPECT_EQ(loaded->labels[i], labels.at(key(loaded->set, i)));
    }
    for (const v1::Scenario& recording : loaded->set.recordings) {
      ids.insert(recording.scenario_id());
    }
  }
  // Examples are left over at the end of a window, so that the last recordings may not come.
  EXPECT_GE(ids.size() * 10, all->training.recordings.size() * 9);
}

TEST_F(WindowedTrainingTest, PredictsHeldOutArcs) {
  TrainingRun run = Run("model");
  run.settings = TinySettings();
  const auto manifest = Train(run, folders_);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_LT(manifest->metrics().at("ade_ratio"), 0.7);
  EXPECT_GE(manifest->metrics().at("effective_actions"), 4.0);
  const auto all = LoadTrainingData(folders_, run.settings, KeepGoing);
  EXPECT_EQ(manifest->provenance().training_examples(),
            static_cast<int64_t>(all->training.examples.size()));
}

// The run keeps the data memory that it began with, whatever those that resume it are given.
TEST_F(WindowedTrainingTest, ARunThatIsStoppedAnywhereEndsWithTheSameWeights) {
  TrainingRun whole = Run("whole");
  whole.baselines = true;
  const absl::Status status = Train(whole, folders_).status();
  ASSERT_TRUE(status.ok()) << status;
  TrainingRun run = Run("resumed");
  run.baselines = true;
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy.interval = std::chrono::hours(1);
  int stops = 0;
  absl::StatusOr<v1::ModelManifest> manifest;
  std::string phase;
  std::set<std::string> stopped_in;
  run.progress = [&](const v1::JobProgress& progress) { phase = progress.phase(); };
  do {
    int asked = 0;
    run.stopped = [&] { return phase != "load" && ++asked > 37 + stops % 5; };
    manifest = Train(run, folders_);
    if (!manifest.ok()) {
      ASSERT_EQ(manifest.status().code(), absl::StatusCode::kCancelled) << manifest.status();
      stopped_in.insert(phase);
    }
    run.data_memory = stops % 2 == 0 ? data::kDefaultDataMemory : Small() / 2;
    ASSERT_LT(++stops, 200);
  } while (!manifest.ok());
  EXPECT_TRUE(stopped_in.contains("joint"));
  EXPECT_TRUE(stopped_in.contains("multipath"));
  EXPECT_TRUE(Weights("whole") == Weights("resumed"));
}

TEST_F(WindowedTrainingTest, GivesTheSameWeightsAgain) {
  ASSERT_TRUE(Train(Run("first"), folders_).ok());
  ASSERT_TRUE(Train(Run("second"), folders_).ok());
  EXPECT_TRUE(Weights("first") == Weights("second"));
}

TEST_F(WindowedTrainingTest, RecordingsThatFitAreLearnedFromAsThoseInMemory) {
  TrainingRun run = Run("folders");
  run.data_memory = bytes_ * data::kMemoryPerByte;
  ASSERT_TRUE(Train(run, folders_).ok());
  const auto data = LoadTrainingData(folders_, run.settings, KeepGoing);
  ASSERT_TRUE(Train(Run("memory"), *data).ok());
  EXPECT_TRUE(Weights("folders") == Weights("memory"));
}

TEST_F(WindowedTrainingTest, RefusesAMemoryInWhichTooFewExamplesFit) {
  const TrainingRun run = Run("model");
  const auto large = OpenTrainingData(folders_, run.settings, 1, 1, KeepGoing);
  EXPECT_EQ(large.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(large.status().message()), HasSubstr("raise --data-memory"));
}

TEST_F(WindowedTrainingTest, ARecordingThatChangedEndsTheRun) {
  const TrainingRun run = Run("model");
  const auto large = OpenSmall(run.settings);
  ASSERT_TRUE(large.ok()) << large.status();
  for (const auto& entry : fs::directory_iterator(folders_[0])) {
    if (entry.path().extension() != ".tfrecord") continue;
    std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(1000);
    file.write("damage", 6);
  }
  absl::StatusCode code = absl::StatusCode::kOk;
  for (const EpochWindow& window : PlanFirstEpoch(*large, run.settings)) {
    const absl::Status status = large->windows->Load(window, KeepGoing).status();
    if (!status.ok()) code = status.code();
  }
  EXPECT_EQ(code, absl::StatusCode::kDataLoss);
  EXPECT_EQ(Train(run, folders_).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_FALSE(fs::exists(run.output));
}

}  // namespace
}  // namespace maneuver::learning::windowed_training_test
