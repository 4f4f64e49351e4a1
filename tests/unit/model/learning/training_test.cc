// Whole runs on analytic scenes: what is learned, and that it is the same again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"
#include "model/inference/action_model.h"
#include "model/learning/checkpoint.h"
#include "model/learning/learner.h"
#include "model/learning/phases/place.h"
#include "model/learning/phases/pretrain.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::training_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class TrainingTest : public testing::Test {
 protected:
  static TrainingData Data() { return *SplitRecordings(ArcRecordings(72), TinySettings()); }

  TrainingRun Run(const std::string& name) {
    TrainingRun run;
    run.settings = TinySettings();
    run.output = folder_ / name;
    run.dataset_names = {"datasets/arcs"};
    run.trainer_version = "test";
    run.progress = [this](const v1::JobProgress& progress) { progress_.push_back(progress); };
    return run;
  }

  // One that learns little.
  TrainingRun ShortRun(const std::string& name) {
    TrainingRun run = Run(name);
    run.settings.mutable_optimization()->set_pretraining_epochs(2);
    run.settings.mutable_optimization()->set_mixture_epochs(1);
    run.settings.mutable_optimization()->set_joint_epochs(1);
    return run;
  }

  const TemporaryFolder folder_;
  std::vector<v1::JobProgress> progress_;
};

std::string ReadBytes(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST_F(TrainingTest, LearnsActionsThatPredictHeldOutArcs) {
  const TrainingData data = Data();
  const auto manifest = Train(Run("model"), data);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  const auto& metrics = manifest->metrics();
  EXPECT_GE(metrics.at("effective_actions"), 4.0);
  // Constant velocity leaves the arcs; the lane says where they go.
  EXPECT_LT(metrics.at("ade_ratio"), 0.7);
  EXPECT_GT(metrics.at("mutual_information"), 0.7);
  EXPECT_EQ(manifest->actions_size(), 6);
  EXPECT_EQ(manifest->provenance().datasets(0), "datasets/arcs");
  EXPECT_EQ(manifest->provenance().training_examples(),
            static_cast<int64_t>(data.training.examples.size()));
  // The recordings drive on, or along arcs of 90 degrees to either side.
  std::set<std::string> names;
  for (const v1::Action& action : manifest->actions()) {
    const std::string& name = action.derived_name();
    names.insert(name);
    const v1::Trajectory& mean = action.distribution().mean_trajectory();
    const double left = *mean.y().rbegin();
    if (!action.effective() || std::abs(left) < 4.0) continue;
    EXPECT_THAT(name, HasSubstr(left > 0.0 ? "left" : "right")) << left;
  }
  EXPECT_EQ(names.size(), 6U);
  EXPECT_FALSE(names.contains(""));
  // What was returned is what is on disk.
  const auto stored = artifact::ReadModelManifest(folder_ / "model");
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(stored->actions_size(), 6);
  EXPECT_EQ(stored->actions(0).derived_name(), manifest->actions(0).derived_name());
  EXPECT_GT(stored->input_ranges().at("speed").high(), 1.0);
  EXPECT_GE(stored->input_ranges().at("agents").low(), 1.0);
  EXPECT_GE(stored->input_ranges().at("map").low(), 1.0);
  EXPECT_THAT(folder_.Names(), testing::ElementsAre("model"));
}

TEST_F(TrainingTest, LearnsPedestriansThatWalkAlongArcs) {
  TrainingRun run = Run("model");
  run.settings = TinyLanesSettings();
  run.settings.mutable_model()->add_target_types(v1::AGENT_TYPE_PEDESTRIAN);
  run.settings.mutable_examples()->clear_training_stride();
  const TrainingData data = *SplitRecordings(WalkRecordings(72), run.settings);
  for (const data::Example& example : data.training.examples) EXPECT_EQ(example.target_id, 1);
  const auto manifest = Train(run, data);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  // In three seconds an arc of 0.2 / m leads a walker of 1.3 m/s 1.4 m away from straight on.
  EXPECT_GT(manifest->metrics().at("fde_cv"), 0.8);
  EXPECT_LT(manifest->metrics().at("ade_ratio"), 0.7);
  EXPECT_EQ(manifest->spec().target_types(0), v1::AGENT_TYPE_PEDESTRIAN);
}

TEST_F(TrainingTest, ReportsEveryPhaseAndTheTermsOfTheBound) {
  ASSERT_TRUE(Train(ShortRun("model"), Data()).ok());
  std::vector<std::string> phases;
  double fraction = 0.0;
  const v1::EpochReport* joint = nullptr;
  for (const v1::JobProgress& progress : progress_) {
    if (phases.empty() || phases.back() != progress.phase()) phases.push_back(progress.phase());
    EXPECT_GE(progress.fraction(), fraction - 1e-9);
    fraction = progress.fraction();
    if (progress.phase() == "export") {  // all is done but loading, this and measuring
      EXPECT_EQ(progress.step() + 2 + kEvaluateSteps + 1, progress.steps());
    }
    if (progress.phase() == "joint" && progress.has_epoch_report()) {
      joint = &progress.epoch_report();
    }
  }
  EXPECT_THAT(phases, testing::ElementsAre("pretrain", "mixture", "joint", "posterior", "calibrate",
                                           "export", "evaluate"));
  ASSERT_NE(joint, nullptr);
  for (const char* term : {"loss", "reconstruction", "action_divergence", "latent_divergence",
                           "posterior_reconstruction", "posterior_divergence"}) {
    EXPECT_TRUE(joint->training().contains(term)) << term;
    EXPECT_TRUE(joint->validation().contains(term)) << term;
  }
  EXPECT_TRUE(joint->validation().contains("log_likelihood"));
  EXPECT_EQ(joint->action_usage_size(), 6);
  EXPECT_GT(joint->smallest_component_stddev(), 0.0);
  EXPECT_GE(joint->largest_component_stddev(), joint->smallest_component_stddev());
}

TEST_F(TrainingTest, WhatFollowsTheRunIsAPartOfItsProgress) {
  TrainingRun run = ShortRun("model");
  run.seconds_after = 20.0;
  ASSERT_TRUE(Train(run, Data()).ok());
  bool has_told = false;
  for (const v1::JobProgress& progress : progress_) {
    if (!progress.has_time_left()) continue;
    has_told = true;
    EXPECT_GE(progress.time_left().seconds(), 20) << progress.phase();
  }
  EXPECT_TRUE(has_told);
  EXPECT_LT(progress_.back().fraction(), 1.0);
}

TEST_F(TrainingTest, AnActionIsEffectiveIfSomeHeldOutExampleGivesItAShare) {
  // More actions than there are motions: some stay idle.
  TrainingRun run = Run("model");
  run.settings.mutable_model()->set_actions(40);
  const auto manifest = Train(run, Data());
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  int effective = 0;
  for (const v1::Action& action : manifest->actions()) effective += action.effective() ? 1 : 0;
  EXPECT_EQ(effective, manifest->metrics().at("effective_actions"));
  EXPECT_LT(effective, 40);
  EXPECT_GE(effective, 4);
}

// Recorded manoeuvres of a tenth of the examples give their names to actions that are them.
TEST_F(TrainingTest, LabelledExamplesMakeActionsOfTheirNames) {
  TrainingRun run = Run("model");
  run.settings.mutable_augmentation()->set_mirror(false);
  TrainingData data = Data();
  data.label_names = {"left", "right"};
  for (size_t i = 0; i < data.training.examples.size(); ++i) {
    const float y = data.training.examples[i].trajectory.back();
    data.labels.push_back(i % 10 != 0 || std::abs(y) < 2.0F ? -1 : y > 0.0F ? 0 : 1);
  }
  const auto manifest = Train(run, data);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_EQ(manifest->actions(0).label(), "left");
  EXPECT_EQ(manifest->actions(1).label(), "right");
  EXPECT_EQ(manifest->actions(2).label(), "");
  EXPECT_GT(*manifest->actions(0).distribution().mean_trajectory().y().rbegin(), 2.0);
  EXPECT_LT(*manifest->actions(1).distribution().mean_trajectory().y().rbegin(), -2.0);
}

TEST_F(TrainingTest, SeveralPlacementsAreTriedAndTheBestBoundIsKept) {
  TrainingRun run = Run("model");
  run.settings.mutable_optimization()->set_mixture_placement(v1::MIXTURE_PLACEMENT_RANDOM);
  run.settings.mutable_optimization()->set_placements(3);
  run.settings.mutable_optimization()->set_pretraining_epochs(5);
  run.settings.mutable_optimization()->set_mixture_epochs(1);
  run.settings.mutable_optimization()->set_joint_epochs(1);
  ASSERT_TRUE(Train(run, Data()).ok());
  std::vector<double> tried;
  double kept = 0.0;
  for (const v1::JobProgress& progress : progress_) {
    if (!progress.has_epoch_report()) continue;
    const double loss = progress.epoch_report().validation().at("loss");
    if (progress.phase() == "place" && progress.epoch() == 3) tried.push_back(loss);
    if (progress.phase() == "mixture") kept = loss;
  }
  ASSERT_EQ(tried.size(), 3u);
  const auto [best, worst] = std::minmax_element(tried.begin(), tried.end());
  EXPECT_LT(*best, *worst);
  // One more epoch on the best one: no worse than the middle between it and the worst.
  EXPECT_LT(kept, 0.5 * (*best + *worst));
}

TEST_F(TrainingTest, AnEpochUsesAtMostMaxExamples) {
  TrainingRun run = ShortRun("model");
  run.settings.mutable_examples()->set_max_examples(50);
  ASSERT_TRUE(Train(run, Data()).ok());
  int64_t before = 0;
  int64_t joint_steps = 0;
  for (const v1::JobProgress& progress : progress_) {
    if (progress.phase() == "mixture") before = progress.step();
    if (progress.phase() == "joint") joint_steps = progress.step() - before;
  }
  EXPECT_EQ(joint_steps, 4);  // 50 examples in batches of 16
}

TEST_F(TrainingTest, OnlyTheSameSeedGivesTheSameWeights) {
  const TrainingData data = Data();
  std::vector<std::string> weights;
  for (const int seed : {7, 7, 8}) {
    TrainingRun run = ShortRun("model" + std::to_string(weights.size()));
    run.settings.set_seed(seed);
    ASSERT_TRUE(Train(run, data).ok());
    weights.push_back(ReadBytes(run.output / "weights.safetensors"));
  }
  EXPECT_TRUE(weights[0] == weights[1]);
  EXPECT_FALSE(weights[0] == weights[2]);
}

// Stopped after each of several numbers of steps, in each phase, in the middle of epochs too.
TEST_F(TrainingTest, ARunResumedFromACheckpointEndsWithTheSameWeights) {
  const TrainingData data = Data();
  const auto prepare = [this](const std::string& name) {
    TrainingRun run = Run(name);
    run.settings.mutable_model()->set_objective(v1::OBJECTIVE_DUAL);
    run.settings.mutable_optimization()->set_pretraining_epochs(2);
    run.settings.mutable_optimization()->set_mixture_epochs(2);
    run.settings.mutable_optimization()->set_joint_epochs(2);
    run.settings.mutable_optimization()->set_posterior_epochs(2);
    return run;
  };
  ASSERT_TRUE(Train(prepare("whole"), data).ok());
  const std::string whole = ReadBytes(folder_ / "whole" / "weights.safetensors");

  TrainingRun run = prepare("resumed");
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy.interval = std::chrono::milliseconds(0);
  std::set<std::string> stopped_in;
  int stops = 0;
  absl::StatusOr<v1::ModelManifest> manifest;
  do {
    // Asked before each step; not always as often, so that it stops anywhere in an epoch, before
    // its first step too.
    int asked = 0;
    run.stopped = [&] { return ++asked > 30 + stops % 7; };
    progress_.clear();
    manifest = Train(run, data);
    ASSERT_FALSE(progress_.empty());
    if (!manifest.ok()) stopped_in.insert(progress_.back().phase());
    ASSERT_LT(++stops, 100);
  } while (!manifest.ok());
  EXPECT_GT(stops, 3);
  EXPECT_TRUE(stopped_in.contains("joint"));
  EXPECT_TRUE(whole == ReadBytes(folder_ / "resumed" / "weights.safetensors"));
}

TEST_F(TrainingTest, SkipsDamagedCheckpointsAndRefusesThoseOfAnotherRun) {
  TrainingRun run = Run("model");
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy.interval = std::chrono::milliseconds(0);
  int asked = 0;
  run.stopped = [&] { return ++asked > 50; };
  const TrainingData data = Data();
  ASSERT_EQ(Train(run, data).status().code(), absl::StatusCode::kCancelled);
  std::set<fs::path> files;
  for (const auto& entry : fs::directory_iterator(run.checkpoints)) files.insert(entry.path());
  ASSERT_EQ(files.size(), 2u);
  auto folder = CheckpointFolder::Open(run.checkpoints, run.checkpoint_policy);
  ASSERT_TRUE(folder.ok());
  const Checkpoint latest = *folder->ReadLatest();
  std::fstream(*files.rbegin(), std::ios::in | std::ios::out | std::ios::binary)
      .seekp(2000)
      .write("damage", 6);
  const Checkpoint earlier = *folder->ReadLatest();
  EXPECT_LT(earlier.optimizer_steps(), latest.optimizer_steps());

  run.settings.set_seed(99);
  run.stopped = nullptr;
  const absl::Status status = Train(run, data).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("other settings"));
}

// Hours between two of them, and yet none of the work is lost: after so many steps there is one,
// and a last one when the run is told to stop.
TEST_F(TrainingTest, WritesCheckpointsAtTheirIntervalAndWhenStopped) {
  TrainingRun run = Run("model");
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy = {.interval = std::chrono::hours(10), .steps = 20, .kept = 3};
  int asked = 0;  // since the second of them
  run.stopped = [&] { return fs::exists(run.checkpoints / "checkpoint-000002") && ++asked > 5; };
  const TrainingData data = Data();
  ASSERT_EQ(Train(run, data).status().code(), absl::StatusCode::kCancelled);
  std::set<std::string> files;
  for (const auto& entry : fs::directory_iterator(run.checkpoints)) {
    files.insert(entry.path().filename());
  }
  ASSERT_EQ(files,
            (std::set<std::string>{"checkpoint-000001", "checkpoint-000002", "checkpoint-000003"}));
  const auto steps = [&] {
    return CheckpointFolder::Open(run.checkpoints, {})->ReadLatest()->optimizer_steps();
  };
  const int64_t last = steps();
  fs::remove(run.checkpoints / "checkpoint-000003");
  const int64_t due = steps();
  fs::remove(run.checkpoints / "checkpoint-000002");
  EXPECT_EQ(due - steps(), 20);
  EXPECT_GT(last, due);
  EXPECT_LT(last, due + 20);
}

TEST_F(TrainingTest, FailsIfFewerActionsAreEffectiveThanRequired) {
  TrainingRun run = ShortRun("model");
  run.least_effective_actions = run.settings.model().actions() + 1;
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(FailureOf(status), TrainingFailure::kCollapsed);
  EXPECT_THAT(std::string(status.message()), HasSubstr("collapsed to"));
  EXPECT_THAT(folder_.Names(), testing::IsEmpty());
}

TEST_F(TrainingTest, StopsWhenAskedAndLeavesNoModel) {
  TrainingRun run = Run("model");
  run.stopped = [this] { return progress_.size() > 3; };
  EXPECT_EQ(Train(run, Data()).status().code(), absl::StatusCode::kCancelled);
  EXPECT_THAT(folder_.Names(), testing::IsEmpty());
}

TEST_F(TrainingTest, ANonFiniteLossEndsTheRun) {
  TrainingRun run = Run("model");
  run.settings.mutable_optimization()->set_learning_rate(1e6);
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kAborted);
  EXPECT_THAT(std::string(status.message()), HasSubstr("learning_rate"));
  EXPECT_THAT(folder_.Names(), testing::IsEmpty());
}

TEST_F(TrainingTest, RefusesADeviceThatDoesNotExist) {
  if (at::hasCUDA()) GTEST_SKIP() << "this LibTorch has CUDA";
  TrainingRun run = Run("model");
  run.settings.set_device("cuda");
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("cuda"));
}

TEST_F(TrainingTest, PlacesComponentsOnTheEncodingsOfClusters) {
  const TrainingData data = Data();
  const v1::TrainingSettings settings = TinySettings();
  TrainingProgress progress(Learner::Plan(settings, {100, 100, 0}), {},
                            [] { return std::chrono::system_clock::time_point(); });
  RankGroup alone([] { return false; });
  Learner learner(settings, data, at::Device(at::kCPU), 1, alone, progress);
  ASSERT_TRUE(Pretrain(learner.state(), learner.loop()).ok());
  ASSERT_TRUE(ChoosePlacement(learner.state(), learner.loop()).ok());
  at::NoGradGuard no_grad;
  Networks& networks = learner.state().networks;
  // Two speeds and three curvatures, straight on among them: each is near the mean trajectory of
  // some component, and the components' means are not all alike.
  const at::Tensor means = networks.Decode(networks.Mixture().mean);
  for (const data::Example& example : data.training.examples) {
    const at::Tensor x = at::tensor(at::ArrayRef<float>(example.trajectory));
    const double nearest = (means - x)
                               .view({means.size(0), -1, 2})
                               .square()
                               .sum(2)
                               .sqrt()
                               .mean(1)
                               .min()
                               .item<double>();
    EXPECT_LT(nearest, 4.0);
  }
  EXPECT_NEAR(networks.MixtureLogWeights().exp().sum().item<double>(), 1.0, 1e-5);
  EXPECT_GT(networks["mixture.mean"].var(0).sum().item<double>(), 0.1);
}

TEST(TrainerTest, DenormalsAreFlushedInTheThreadThatAsksAndInThoseThatItStarts) {
  const auto tiny = [] {
    volatile float factor = 1e-30f;
    return factor * 1e-10f;
  };
  EXPECT_GT(tiny(), 0.0f);
  float own = -1.0f;
  float started = -1.0f;
  std::thread([&] {
    FlushDenormals();
    own = tiny();
    std::thread([&] { started = tiny(); }).join();
  }).join();
  EXPECT_EQ(own, 0.0f);
  EXPECT_EQ(started, 0.0f);
  EXPECT_GT(tiny(), 0.0f);
}

}  // namespace
}  // namespace maneuver::learning::training_test
