// Labels from a file, all the way to the posterior that the trainer learns from.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/label_file.h"
#include "model/learning/objectives.h"
#include "model/learning/scene_loader.h"
#include "model/learning/training_data.h"
#include "model/learning/validation.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::label_file_learning_test {
namespace {

TEST(LabelFileLearningTest, ALabelIsTheOneHotPosteriorOfItsExample) {
  const TemporaryFolder folder;
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_examples()->set_label_share(1.0);
  const std::vector<v1::Scenario> recordings = ArcRecordings(60);

  // The first example of every fourth recording is labelled, a little beside its time.
  std::string file = "recording,target,time,action\n";
  std::set<std::string> labelled;
  auto writer = data::DatasetWriter::Create(folder / "arcs", "a test");
  for (size_t i = 0; i < recordings.size(); ++i) {
    ASSERT_TRUE((*writer)->Add(recordings[i]).ok());
    if (i % 4 != 0) continue;
    const auto examples =
        data::EnumerateExamples(recordings[i], 0, settings.model(), settings.examples());
    ASSERT_FALSE(examples.empty());
    const bool is_left = examples[0].trajectory.back() > 0.0F;
    absl::StrAppend(&file, recordings[i].scenario_id(), ",", examples[0].target_id, ",",
                    examples[0].time + 0.1, is_left ? ",to_the_left\n" : ",to_the_right\n");
    labelled.insert(recordings[i].scenario_id());
  }
  ASSERT_TRUE((*writer)->Commit().ok());
  const auto labels = data::CheckLabels(file, folder / "arcs");
  ASSERT_TRUE(labels.ok()) << labels.status();
  ASSERT_EQ(labels->problem_count, 0) << labels->problems[0].what;
  ASSERT_TRUE(
      data::AnnotateDataset(folder / "arcs", labels->annotations, folder / "labelled").ok());

  const std::vector<std::filesystem::path> folders = {folder / "labelled"};
  const auto data = LoadTrainingData(folders, settings, [] { return true; });
  ASSERT_TRUE(data.ok()) << data.status();
  EXPECT_THAT(data->label_names, testing::ElementsAre("to_the_left", "to_the_right"));
  const auto& examples = data->training.examples;
  ASSERT_EQ(data->labels.size(), examples.size());

  SceneLoader::Batch batch;
  for (size_t i = 0; i < examples.size(); ++i) {
    batch.items.push_back({.example = static_cast<int64_t>(i), .variation = {}});
  }
  const auto count = static_cast<int64_t>(examples.size());
  const int64_t actions = settings.model().actions();
  const at::Tensor unlabelled = at::log_softmax(at::randn({count, actions}), 1);
  const at::Tensor q_y = WithLabels(unlabelled, BatchLabels(data->labels, batch)).exp();

  int one_hot = 0;
  std::set<std::string> met;
  for (int64_t i = 0; i < count; ++i) {
    const data::Example& example = examples[static_cast<size_t>(i)];
    const std::string& id =
        data->training.recordings[static_cast<size_t>(example.recording)].scenario_id();
    const bool is_labelled = labelled.contains(id) && met.insert(id).second;
    if (!is_labelled) {
      EXPECT_TRUE(at::allclose(q_y[i], unlabelled[i].exp())) << id << " at " << example.time;
      continue;
    }
    ++one_hot;
    const int64_t action = example.trajectory.back() > 0.0F ? 0 : 1;
    for (int64_t y = 0; y < actions; ++y) {
      EXPECT_NEAR(q_y[i][y].item<double>(), y == action ? 1.0 : 0.0, 1e-6) << id;
    }
  }
  EXPECT_GE(one_hot, 10);
}

}  // namespace
}  // namespace maneuver::learning::label_file_learning_test
