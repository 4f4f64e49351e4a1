// Whole runs on analytic scenes: what is learned, that it is the same again, and that the engine
// says what LibTorch says.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>

#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"
#include "model/inference/action_model.h"
#include "model/learning/calibration.h"
#include "model/learning/checkpoint.h"
#include "model/learning/learner.h"
#include "model/learning/moments.h"
#include "model/learning/optimizer.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// A folder of the test's own, gone afterwards.
class TrainingTest : public testing::Test {
 protected:
  TrainingTest() {
    folder_ =
        fs::path(testing::TempDir()) /
        (std::string("learning-") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~TrainingTest() override { fs::remove_all(folder_); }

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

  fs::path folder_;
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
  // What was returned is what is on disk.
  const auto stored = artifact::ReadModelManifest(folder_ / "model");
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(stored->actions_size(), 6);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(TrainingTest, ReportsEveryPhaseAndTheTermsOfTheBound) {
  ASSERT_TRUE(Train(Run("model"), Data()).ok());
  std::vector<std::string> phases;
  double fraction = 0.0;
  const v1::EpochReport* joint = nullptr;
  for (const v1::JobProgress& progress : progress_) {
    if (phases.empty() || phases.back() != progress.phase()) phases.push_back(progress.phase());
    EXPECT_GE(progress.fraction(), fraction - 1e-9);
    fraction = progress.fraction();
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

TEST_F(TrainingTest, AnEpochIsOverAtMostMaxExamples) {
  TrainingRun run = Run("model");
  run.settings.mutable_examples()->set_max_examples(50);
  run.settings.mutable_optimization()->set_pretraining_epochs(2);
  run.settings.mutable_optimization()->set_mixture_epochs(1);
  run.settings.mutable_optimization()->set_joint_epochs(1);
  ASSERT_TRUE(Train(run, Data()).ok());
  int64_t before = 0;
  int64_t joint_steps = 0;
  for (const v1::JobProgress& progress : progress_) {
    if (progress.phase() == "mixture") before = progress.step();
    if (progress.phase() == "joint") joint_steps = progress.step() - before;
  }
  EXPECT_EQ(joint_steps, 4);  // 50 examples in batches of 16
}

TEST_F(TrainingTest, TheSameSeedGivesTheSameWeightsAndAnotherSeedOthers) {
  const TrainingData data = Data();
  std::vector<std::string> weights;
  for (const int seed : {7, 7, 8}) {
    TrainingRun run = Run("model" + std::to_string(weights.size()));
    run.settings.set_seed(seed);
    run.settings.mutable_optimization()->set_pretraining_epochs(2);
    run.settings.mutable_optimization()->set_mixture_epochs(1);
    run.settings.mutable_optimization()->set_joint_epochs(1);
    ASSERT_TRUE(Train(run, data).ok());
    weights.push_back(ReadBytes(run.output / "weights.safetensors"));
  }
  EXPECT_TRUE(weights[0] == weights[1]);
  EXPECT_FALSE(weights[0] == weights[2]);
}

// Stopped after each of several numbers of steps, in each phase, in the middle of epochs too.
TEST_F(TrainingTest, ARunThatGoesOnFromACheckpointEndsWithTheSameWeights) {
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

TEST_F(TrainingTest, ADamagedCheckpointIsPassedOverAndOnesOfAnotherRunAreRefused) {
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
TEST_F(TrainingTest, CheckpointsAreWrittenAfterSoManyStepsAndWhenTheRunIsStopped) {
  TrainingRun run = Run("model");
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy = {.interval = std::chrono::hours(10), .steps = 20, .kept = 3};
  int asked = 0;
  run.stopped = [&] { return ++asked > 50; };
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

TEST_F(TrainingTest, AModelOfTooFewActionsFailsWhereThatIsAsked) {
  TrainingRun run = Run("model");
  run.least_effective_actions = run.settings.model().actions() + 1;
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(FailureOf(status), TrainingFailure::kCollapsed);
  EXPECT_THAT(std::string(status.message()), HasSubstr("collapsed to"));
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TrainingTest, StopsWhenToldAndLeavesNothing) {
  TrainingRun run = Run("model");
  run.stopped = [this] { return progress_.size() > 3; };
  EXPECT_EQ(Train(run, Data()).status().code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TrainingTest, ALossThatIsNotFiniteEndsTheRun) {
  TrainingRun run = Run("model");
  run.settings.mutable_optimization()->set_learning_rate(1e6);
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kAborted);
  EXPECT_THAT(std::string(status.message()), HasSubstr("learning_rate"));
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TrainingTest, ADeviceThatIsNotThereIsRefused) {
  if (at::hasCUDA()) GTEST_SKIP() << "this LibTorch has CUDA";
  TrainingRun run = Run("model");
  run.settings.set_device("cuda");
  const absl::Status status = Train(run, Data()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("cuda"));
}

void ExpectClose(const at::Tensor& expected, const Eigen::VectorXd& actual, const char* what) {
  const at::Tensor plain = expected.detach().to(at::kDouble).contiguous().flatten();
  ASSERT_EQ(plain.numel(), actual.size()) << what;
  const Eigen::Map<const Eigen::VectorXd> values(plain.data_ptr<double>(), plain.numel());
  EXPECT_LE((values - actual).norm(), 1e-4 * values.norm() + 1e-7) << what;
}

// Every network of the engine, f32, against LibTorch's.
TEST_F(TrainingTest, TheEngineSaysWhatLibTorchSays) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_optimization()->set_pretraining_epochs(4);
  settings.mutable_optimization()->set_mixture_epochs(2);
  settings.mutable_optimization()->set_joint_epochs(2);
  const TrainingData data = Data();
  RunProgress progress(Learner::Plan(settings, static_cast<int64_t>(data.training.examples.size())),
                       {}, [] { return std::chrono::system_clock::time_point(); });
  Learner learner(
      settings, data, at::Device(at::kCPU), 1, [] { return false; }, progress);
  for (const auto phase : {&Learner::Pretrain, &Learner::PlaceMixture, &Learner::TrainMixture,
                           &Learner::TrainJointly, &Learner::Calibrate}) {
    ASSERT_TRUE((learner.*phase)().ok());
  }
  Networks& networks = learner.networks();
  v1::ModelManifest manifest;
  *manifest.mutable_spec() = settings.model();
  ASSERT_TRUE(artifact::WriteModelFolder(folder_ / "model", {manifest, networks.Export()}).ok());
  const auto model = inference::ActionModel::Load(folder_ / "model", {inference::Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();
  const auto session = (*model)->NewSession();

  at::NoGradGuard no_grad;
  constexpr int64_t kExamples = 5;
  const std::vector<RasterLoader::Item> items = DrawItems(data.validation, kExamples);
  RasterLoader loader(settings.model().raster(), data.validation, items, kExamples, 1);
  RasterLoader::Batch batch = *loader.Next();
  const at::Tensor x = VariedTrajectories(data.validation, batch);
  const at::Tensor features = networks.EncodeScenes(RasterTensor(settings.model().raster(), batch),
                                                    VariedMotions(data.validation, batch), {});
  const at::Tensor log_p_y = networks.PredictActions(features);
  const Gaussian posterior = networks.EncodeScenarios(features);
  const Gaussian q_z = networks.EncodeTrajectories(x);
  const Gaussian mixture = networks.Mixture();
  const at::Tensor q_y =
      UnifiedLogResponsibilities(
          log_p_y, CrossEntropy({q_z.mean.unsqueeze(1), q_z.log_variance.unsqueeze(1)}, mixture),
          Divergence(posterior, mixture))
          .exp();
  const WaypointMoments moments = LatentMoments(networks, posterior);

  const size_t bytes = scene::RasterBytes(settings.model().raster());
  for (int64_t i = 0; i < kExamples; ++i) {
    const uint8_t* raster = batch.rasters.data() + static_cast<size_t>(i) * bytes;
    inference::SceneEncoding encoding;
    const inference::SceneInput scene{
        raster, data.validation.examples[static_cast<size_t>(items[static_cast<size_t>(i)].example)]
                    .motion};
    session->Encode({&scene, 1}, {&encoding, 1});
    ExpectClose(features[i], encoding.features.cast<double>(), "features");
    ExpectClose(log_p_y[i].exp(), encoding.probabilities, "p(y|s)");
    const std::vector<int> actions = {4, 0};
    const auto distributions =
        session->Describe(encoding, actions, inference::LatentSource::kPosterior);
    for (size_t j = 0; j < actions.size(); ++j) {
      const int64_t k = actions[j];
      const inference::ActionDistribution& actual = distributions[j];
      ExpectClose(posterior.mean[i][k], actual.latent_mean, "mean of q(z|y,s)");
      ExpectClose((0.5 * posterior.log_variance[i][k]).exp(), actual.latent_stddev,
                  "deviation of q(z|y,s)");
      ExpectClose(networks.Decode(posterior.mean[i][k]),
                  Eigen::Map<const Eigen::VectorXd>(actual.mean().data(), actual.mean().size()),
                  "mean trajectory");
      ExpectClose(
          moments.mean[i][k],
          Eigen::Map<const Eigen::VectorXd>(actual.moment_mean.data(), actual.moment_mean.size()),
          "moment mean");
      ExpectClose(moments.covariance[i][k] + networks["decoder.covariance"][k],
                  Eigen::Map<const Eigen::VectorXd>(actual.moment_covariance.data(),
                                                    actual.moment_covariance.size()),
                  "moment covariance");
    }
    inference::Trajectory trajectory(x.size(1) / 2, 2);
    for (int64_t c = 0; c < x.size(1); ++c) trajectory.data()[c] = x[i][c].item<float>();
    ExpectClose(q_y[i], session->Classify(encoding, trajectory).responsibilities, "q(y|x,s)");
  }
}

TEST_F(TrainingTest, PlacesComponentsOnTheEncodingsOfClusters) {
  const TrainingData data = Data();
  const v1::TrainingSettings settings = TinySettings();
  RunProgress progress(Learner::Plan(settings, 100), {},
                       [] { return std::chrono::system_clock::time_point(); });
  Learner learner(
      settings, data, at::Device(at::kCPU), 1, [] { return false; }, progress);
  ASSERT_TRUE(learner.Pretrain().ok());
  ASSERT_TRUE(learner.PlaceMixture().ok());
  at::NoGradGuard no_grad;
  Networks& networks = learner.networks();
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

TEST(OptimizerTest, StepsAsAdamWIsDefined) {
  at::Tensor weights = at::tensor({1.0, -2.0}, at::kDouble).view({1, 2}).set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({weights}, 0.1, 0.5);
  double expected[] = {1.0, -2.0};
  double m[] = {0.0, 0.0}, v[] = {0.0, 0.0};
  for (int step = 1; step <= 3; ++step) {
    weights.square().sum().backward();
    for (int i = 0; i < 2; ++i) {
      const double gradient = 2.0 * expected[i];
      m[i] = 0.9 * m[i] + 0.1 * gradient;
      v[i] = 0.999 * v[i] + 0.001 * gradient * gradient;
      expected[i] -= 0.1 * 0.5 * expected[i];
      expected[i] -= 0.1 * (m[i] / (1.0 - std::pow(0.9, step))) /
                     (std::sqrt(v[i] / (1.0 - std::pow(0.999, step))) + 1e-8);
    }
    optimizer.Step(1.0);
    EXPECT_NEAR(weights[0][0].item<double>(), expected[0], 1e-9);
    EXPECT_NEAR(weights[0][1].item<double>(), expected[1], 1e-9);
  }
}

TEST(OptimizerTest, LearningRateWarmsUpAndThenFallsToZero) {
  EXPECT_LT(LearningRateShare(0, 100, 2000), 0.02);
  EXPECT_NEAR(LearningRateShare(100, 100, 2000), 1.0, 1e-9);
  EXPECT_NEAR(LearningRateShare(1050, 100, 2000), 0.5, 1e-9);
  EXPECT_LT(LearningRateShare(1999, 100, 2000), 1e-4);
}

// Predictions of two actions whose residuals have known covariances.
Predictions KnownPredictions(at::Generator& generator, double scale) {
  constexpr int64_t kExamples = 4000;
  Predictions predictions;
  predictions.mean = at::zeros({kExamples, 2, 1, 2}, at::kFloat);
  predictions.mean.select(1, 1).fill_(100.0);
  predictions.covariance = at::zeros({kExamples, 2, 1, 3}, at::kFloat);
  predictions.log_probabilities = at::full({kExamples, 2}, std::log(0.5), at::kFloat);
  predictions.log_responsibilities = at::full({kExamples, 2}, -50.0, at::kFloat);
  at::Tensor x = at::empty({kExamples, 2}, at::kFloat).normal_(0.0, 1.0, generator);
  x.select(1, 0).mul_(2.0 * scale);  // deviations of 2 m along and 0.5 m across
  x.select(1, 1).mul_(0.5 * scale);
  x.slice(0, kExamples / 2).add_(100.0);
  predictions.log_responsibilities.slice(0, 0, kExamples / 2).select(1, 0).zero_();
  predictions.log_responsibilities.slice(0, kExamples / 2).select(1, 1).zero_();
  predictions.trajectories = x;
  return predictions;
}

TEST(CalibrationTest, DecoderCovarianceIsThatOfTheResiduals) {
  at::Generator generator = MakeGenerator(1);
  const Predictions predictions = KnownPredictions(generator, 1.0);
  const at::Tensor covariance = FitDecoderCovariance(predictions, generator);
  for (int k = 0; k < 2; ++k) {
    EXPECT_NEAR(covariance[k][0][0].item<double>(), 4.0, 0.4);
    EXPECT_NEAR(covariance[k][0][1].item<double>(), 0.0, 0.1);
    EXPECT_NEAR(covariance[k][0][2].item<double>(), 0.25, 0.025);
  }
}

TEST(CalibrationTest, WhatTheLatentExplainsIsNotCountedTwice) {
  at::Generator generator = MakeGenerator(1);
  Predictions predictions = KnownPredictions(generator, 1.0);
  predictions.covariance.select(3, 0).fill_(3.0);
  const at::Tensor covariance = FitDecoderCovariance(predictions, generator);
  EXPECT_NEAR(covariance[0][0][0].item<double>(), 1.0, 0.4);
}

TEST(CalibrationTest, CovarianceScaleFollowsHeldOutResiduals) {
  at::Generator generator = MakeGenerator(1);
  const Predictions training = KnownPredictions(generator, 1.0);
  const at::Tensor covariance = FitDecoderCovariance(training, generator);
  const at::Tensor scale = FitCovarianceScale(KnownPredictions(generator, 1.5), covariance);
  EXPECT_NEAR(scale[0].item<double>(), 2.25, 0.2);
}

TEST(CalibrationTest, TemperatureUndoesOverconfidence) {
  at::Generator generator = MakeGenerator(1);
  const at::Tensor logits = at::empty({4000, 5}, at::kFloat).normal_(0.0, 1.0, generator);
  const at::Tensor log_q = at::log_softmax(logits, 1);
  EXPECT_NEAR(FitTemperature(at::log_softmax(2.0 * logits, 1), log_q), 2.0, 0.02);
  EXPECT_NEAR(FitTemperature(log_q, log_q), 1.0, 0.01);
}

TEST(MomentsTest, WaypointLogLikelihoodIsThatOfAMixtureOfGaussians) {
  const at::Tensor log_p = at::tensor({0.3, 0.7}, at::kDouble).log().view({1, 2});
  const at::Tensor mean = at::tensor({0.0, 0.0, 2.0, 1.0}, at::kDouble).view({1, 2, 1, 2});
  const at::Tensor covariance =
      at::tensor({1.0, 0.0, 4.0, 2.0, 0.5, 1.0}, at::kDouble).view({1, 2, 1, 3});
  const at::Tensor x = at::tensor({1.0, 0.5}, at::kDouble).view({1, 2});
  // N((1, .5); 0, diag(1, 4)) and N((-1, -.5); 0, [2 .5; .5 1]), determinant 1.75.
  const double first = std::exp(-0.5 * (1.0 + 0.25 / 4.0)) / (2.0 * M_PI * 2.0);
  const double quadratic = (1.0 * 1.0 - 2.0 * 0.5 * 0.5 + 2.0 * 0.25) / 1.75;
  const double second = std::exp(-0.5 * quadratic) / (2.0 * M_PI * std::sqrt(1.75));
  EXPECT_NEAR(WaypointLogLikelihood(log_p, mean, covariance, x).item<double>(),
              std::log(0.3 * first + 0.7 * second), 1e-12);
}

}  // namespace
}  // namespace maneuver::learning
