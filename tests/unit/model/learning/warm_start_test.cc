// Runs that start from a model, and epochs that are drawn from several datasets.

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <numeric>
#include <set>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/data/dataset_folder.h"
#include "model/inference/action_model.h"
#include "model/learning/example_order.h"
#include "model/learning/networks.h"
#include "model/learning/scene_loader.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "model/scene/scene_reader.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::warm_start_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

std::vector<int64_t> Values(const at::Tensor& indices) {
  return {indices.data_ptr<int64_t>(), indices.data_ptr<int64_t>() + indices.numel()};
}

TEST(SharesTest, SharesAddUpAndAreProportionalToTheWeights) {
  EXPECT_THAT(SharesOf(std::vector<double>{3.0, 1.0}, 400), ElementsAre(300, 100));
  EXPECT_THAT(SharesOf(std::vector<double>{1.0, 1.0, 1.0}, 100), ElementsAre(33, 34, 33));
  EXPECT_THAT(SharesOf(std::vector<double>{1e-6, 1.0}, 10), ElementsAre(0, 10));
}

TEST(DrawExamplesTest, WithoutWeightsEachExampleIsDrawnAtMostOnce) {
  at::Generator generator = MakeGenerator(1);
  const std::vector<int64_t> drawn =
      Values(DrawExamples(std::vector<int64_t>{5, 7}, {}, 10, generator));
  EXPECT_EQ(std::set<int64_t>(drawn.begin(), drawn.end()).size(), 10u);
}

TEST(DrawExamplesTest, ASmallDatasetWithALargeWeightRepeatsEvenly) {
  at::Generator generator = MakeGenerator(1);
  const std::vector<int64_t> drawn = Values(
      DrawExamples(std::vector<int64_t>{90, 10}, std::vector<double>{1.0, 3.0}, 100, generator));
  ASSERT_EQ(drawn.size(), 100u);
  std::map<int64_t, int> times;
  for (const int64_t example : drawn) ++times[example];
  int of_second = 0;
  for (const auto& [example, count] : times) {
    EXPECT_LT(example, 100);
    const bool is_of_second = example >= 90;
    EXPECT_GE(count, is_of_second ? 7 : 1);
    EXPECT_LE(count, is_of_second ? 8 : 1);
    of_second += is_of_second ? count : 0;
  }
  EXPECT_EQ(of_second, 75);
  // Not one dataset after the other.
  EXPECT_TRUE(std::any_of(drawn.begin(), drawn.begin() + 50, [](int64_t i) { return i >= 90; }));
  EXPECT_TRUE(std::any_of(drawn.begin() + 50, drawn.end(), [](int64_t i) { return i >= 90; }));
}

TEST(DrawExamplesTest, SpreadExamplesFollowTheWeightsOfTheDatasets) {
  EXPECT_THAT(Values(SpreadExamples(std::vector<int64_t>{4, 4}, {}, 4)), ElementsAre(0, 2, 4, 6));
  EXPECT_THAT(Values(SpreadExamples(std::vector<int64_t>{4, 4}, std::vector<double>{3.0, 1.0}, 4)),
              ElementsAre(0, 1, 2, 4));
}

TEST(VariedItemsTest, ARepeatedExampleGetsANewVariation) {
  const std::vector<int64_t> order = {3, 5, 3};
  const auto items = VariedItems(TinySettings(), order, 0, 1);
  ASSERT_EQ(items.size(), 3u);
  EXPECT_EQ(items[2].example, 3);
  EXPECT_NE(items[0].variation.scale, items[2].variation.scale);
  // The rest of an epoch is what it would have been.
  const auto rest = VariedItems(TinySettings(), order, 2, 1);
  ASSERT_EQ(rest.size(), 1u);
  EXPECT_EQ(rest[0].variation.scale, items[2].variation.scale);
}

class WarmStartTest : public testing::Test {
 protected:
  TrainingRun Run(const std::string& name) {
    TrainingRun run;
    run.settings = TinySettings();
    run.settings.mutable_optimization()->set_pretraining_epochs(4);
    run.settings.mutable_optimization()->set_mixture_epochs(4);
    run.settings.mutable_optimization()->set_joint_epochs(2);
    run.output = folder_ / name;
    run.progress = [this](const v1::JobProgress& progress) { phases_.insert(progress.phase()); };
    return run;
  }
  TrainingRun From(const std::string& start, const std::string& name) {
    phases_.clear();
    TrainingRun run = Run(name);
    run.start_from = folder_ / start;
    run.start_from_name = "models/arcs/versions/1";
    return run;
  }

  const TrainingData data_ = *SplitRecordings(ArcRecordings(72), TinySettings());
  const TemporaryFolder folder_;
  std::set<std::string> phases_;
};

TEST_F(WarmStartTest, ExportReturnsTheImportedWeights) {
  TrainingRun run = Run("first");
  ASSERT_TRUE(Train(run, data_).ok());
  const auto stored = artifact::ReadModelFolder(folder_ / "first");
  ASSERT_TRUE(stored.ok());
  at::Generator generator = MakeGenerator(7);
  Networks networks(run.settings.model(), at::kCPU, generator);
  // Of other data: the coefficients of the decoder's curves are other numbers.
  networks.Standardize(
      3.0 * at::randn({50, 2 * run.settings.model().trajectory().waypoints()}, generator), false);
  networks.Import(stored->weights);
  for (const auto& [name, tensor] : networks.Export()) {
    const std::vector<float>& before = stored->weights.at(name).values;
    ASSERT_EQ(tensor.values.size(), before.size()) << name;
    for (size_t i = 0; i < before.size(); ++i) {
      ASSERT_NEAR(tensor.values[i], before[i], 1e-5 + 1e-4 * std::abs(before[i])) << name;
    }
  }
}

TEST_F(WarmStartTest, KeepsTheActionsOfTheStartAndSkipsTheFirstPhases) {
  ASSERT_TRUE(Train(Run("first"), data_).ok());
  EXPECT_TRUE(phases_.contains("mixture"));
  auto manifest = *artifact::ReadModelManifest(folder_ / "first");
  manifest.mutable_actions(2)->set_label("left");
  manifest.mutable_actions(1)->set_derived_name("as it was called");
  ASSERT_TRUE(artifact::RewriteModelManifest(folder_ / "first", manifest).ok());

  TrainingRun run = From("first", "second");
  run.settings.mutable_optimization()->set_learning_rate(1e-5);
  const auto second = Train(run, data_);
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_THAT(phases_, testing::IsSupersetOf({"joint", "posterior"}));
  EXPECT_FALSE(phases_.contains("pretrain"));
  EXPECT_FALSE(phases_.contains("mixture"));
  EXPECT_EQ(second->provenance().start_from(), "models/arcs/versions/1");
  EXPECT_EQ(second->actions(2).label(), "left");
  EXPECT_EQ(second->actions(1).derived_name(), "as it was called");
  // So small a rate changes next to nothing: action k is still action k.
  for (int k = 0; k < manifest.actions_size(); ++k) {
    const v1::Trajectory& before = manifest.actions(k).distribution().mean_trajectory();
    const v1::Trajectory& after = second->actions(k).distribution().mean_trajectory();
    ASSERT_GT(before.x_size(), 0);
    for (int i = 0; i < before.x_size(); ++i) {
      EXPECT_NEAR(after.x(i), before.x(i), 0.05) << k;
      EXPECT_NEAR(after.y(i), before.y(i), 0.05) << k;
    }
  }
}

TEST_F(WarmStartTest, ABaseModelKeepsNothingThatTheStartReadOfTheScene) {
  TrainingRun run = Run("unified");
  run.settings = TinyLanesSettings();
  run.settings.mutable_optimization()->set_pretraining_epochs(4);
  run.settings.mutable_optimization()->set_mixture_epochs(2);
  run.settings.mutable_optimization()->set_joint_epochs(2);
  const TrainingData data = *SplitRecordings(ArcRecordings(72), run.settings);
  ASSERT_TRUE(Train(run, data).ok());
  run.settings.mutable_model()->set_objective(v1::OBJECTIVE_BASE);
  run.start_from = run.output;
  run.output = folder_ / "base";
  const auto base = Train(run, data);
  ASSERT_TRUE(base.ok()) << base.status();

  const auto model = inference::ActionModel::Load(run.output, {inference::Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();
  const auto session = (*model)->NewSession();
  const data::Example& example = data.validation.examples.at(0);
  const v1::Scenario& recording =
      data.validation.recordings.at(static_cast<size_t>(example.recording));
  scene::SceneReader reader((*model)->spec());
  scene::SceneInputs inputs = reader.NewInputs();
  reader.Read(recording, scene::RoadMap::Over(recording.map_features()), example.time,
              example.target_id, example.X_WT, &inputs);
  const inference::SceneInputsView scene = inference::ViewOf(inputs);
  inference::SceneEncoding encoding;
  session->Encode({&scene, 1}, {&encoding, 1});
  std::vector<int> actions(static_cast<size_t>((*model)->spec().actions()));
  std::iota(actions.begin(), actions.end(), 0);
  const auto here = session->Describe(encoding, actions, inference::LatentSource::kPosterior);
  const auto generic = session->Describe(encoding, actions, inference::LatentSource::kPrior);
  for (const int k : actions) {
    const auto action = static_cast<size_t>(k);
    EXPECT_LT((here[action].latent_mean - generic[action].latent_mean).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT((here[action].latent_stddev - generic[action].latent_stddev).cwiseAbs().maxCoeff(),
              1e-6);
    EXPECT_LT((here[action].mean() - generic[action].mean()).cwiseAbs().maxCoeff(), 1e-6) << k;
  }
}

TEST_F(WarmStartTest, AnInterruptedRunEndsWithTheSameWeightsAndRecordsItsStart) {
  ASSERT_TRUE(Train(Run("first"), data_).ok());
  ASSERT_TRUE(Train(From("first", "straight"), data_).ok());

  TrainingRun run = From("first", "resumed");
  run.checkpoints = folder_ / "checkpoints";
  int asked = 0;
  run.stopped = [&asked] { return ++asked > 40; };
  ASSERT_EQ(Train(run, data_).status().code(), absl::StatusCode::kCancelled);
  // Checkpoints of a run with a start are of no use to one without.
  TrainingRun other = Run("other");
  other.checkpoints = run.checkpoints;
  EXPECT_THAT(std::string(Train(other, data_).status().message()), HasSubstr("another start"));
  run.stopped = nullptr;
  ASSERT_TRUE(Train(run, data_).ok());
  EXPECT_EQ(artifact::ReadModelManifest(folder_ / "resumed")->weights_sha256(),
            artifact::ReadModelManifest(folder_ / "straight")->weights_sha256());
}

TEST_F(WarmStartTest, RefusesLabelsThatNoActionHas) {
  ASSERT_TRUE(Train(Run("first"), data_).ok());
  TrainingData labelled = data_;
  labelled.label_names = {"left"};
  labelled.labels.assign(labelled.training.examples.size(), -1);
  const absl::Status status = Train(From("first", "second"), labelled).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("action 0"));
  EXPECT_FALSE(fs::exists(folder_ / "second"));
}

TEST_F(WarmStartTest, RefusesAMissingStartOrOneOfOtherSizes) {
  ASSERT_TRUE(Train(Run("first"), data_).ok());
  TrainingRun run = From("first", "second");
  run.settings.mutable_model()->set_actions(5);
  EXPECT_EQ(Train(run, data_).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Train(From("nowhere", "second"), data_).status().code(), absl::StatusCode::kNotFound);
}

// Dataset folders of some recordings, one after another.
class MixingTest : public WarmStartTest {
 protected:
  fs::path Write(const std::string& name, std::vector<v1::Scenario> recordings) {
    auto writer = data::DatasetWriter::Create(folder_ / name, "test");
    EXPECT_TRUE(writer.ok()) << writer.status();
    for (const v1::Scenario& recording : recordings) EXPECT_TRUE((*writer)->Add(recording).ok());
    EXPECT_TRUE((*writer)->Commit().ok());
    return folder_ / name;
  }
};

TEST_F(MixingTest, CountsExamplesByDatasetAndRefusesEmptyOnes) {
  std::vector<v1::Scenario> arcs = ArcRecordings(40);
  v1::Scenario empty = arcs[0];
  empty.set_scenario_id("empty");
  empty.clear_agents();
  const std::vector<fs::path> folders = {Write("a", {arcs.begin(), arcs.begin() + 30}),
                                         Write("b", {arcs.begin() + 30, arcs.end()})};
  v1::TrainingSettings settings = TinySettings();
  const auto load = [&](const std::vector<fs::path>& from) {
    return LoadTrainingData(from, settings, [] { return true; });
  };
  settings.mutable_examples()->add_dataset_weights(1.0);
  EXPECT_EQ(load(folders).status().code(), absl::StatusCode::kInvalidArgument);
  settings.mutable_examples()->add_dataset_weights(3.0);
  const auto data = load(folders);
  ASSERT_TRUE(data.ok()) << data.status();
  ASSERT_EQ(data->folder_examples.size(), 2u);
  EXPECT_GT(data->folder_examples[0], data->folder_examples[1]);
  EXPECT_EQ(data->folder_examples[0] + data->folder_examples[1],
            static_cast<int64_t>(data->training.examples.size()));
  const absl::Status none = load({folders[0], Write("c", {empty})}).status();
  EXPECT_EQ(FailureOf(none), TrainingFailure::kNotEnoughExamples);
  EXPECT_THAT(std::string(none.message()), HasSubstr("dataset_weights[1]"));
}

TEST_F(MixingTest, AModelFitsTheDatasetWithTheLargestWeightBest) {
  // The same road, on which half of the recordings turn left and half go right.
  std::vector<v1::Scenario> left, right;
  for (int i = 0; i < 24; ++i) {
    left.push_back(ForkRecording("l" + std::to_string(i), Fork::kBoth, true, 0.04));
    right.push_back(ForkRecording("r" + std::to_string(i), Fork::kBoth, false, 0.04));
  }
  const std::vector<fs::path> folders = {Write("left", left), Write("right", right)};
  std::map<double, double> share;  // of the actions that end to the left, by the weight of `left`
  for (const double weight : {0.2, 5.0}) {
    TrainingRun run = Run(std::to_string(weight));
    run.settings.mutable_examples()->add_dataset_weights(weight);
    run.settings.mutable_examples()->add_dataset_weights(1.0);
    run.settings.mutable_augmentation()->set_mirror(false);
    const auto manifest = Train(run, folders);
    ASSERT_TRUE(manifest.ok()) << manifest.status();
    for (const v1::Action& action : manifest->actions()) {
      const auto& y = action.distribution().mean_trajectory().y();
      if (*y.rbegin() > 1.0) share[weight] += action.usage();
    }
  }
  EXPECT_GT(share[5.0], share[0.2] + 0.1);
}

}  // namespace
}  // namespace maneuver::learning::warm_start_test
