// The anchor baselines: their losses, what they learn, and that the engine measures them.

#include <ATen/ops/empty_like.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "model/artifact/anchor_baselines.h"
#include "model/inference/action_model.h"
#include "model/inference/anchor_model.h"
#include "model/learning/anchors/anchor_learner.h"
#include "model/learning/anchors/anchor_networks.h"
#include "model/learning/learner.h"
#include "model/learning/scene_loader.h"
#include "model/learning/trainer.h"
#include "model/learning/validation.h"
#include "model/scene/rasterizer.h"
#include "model/scene/scene_reader.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/model/scene/raster_of.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::anchors_test {
namespace {

namespace fs = std::filesystem;

// Two anchors, two waypoints; the first anchor is the nearer one.
struct HandMade {
  at::Tensor numbers = at::tensor({0.3, -0.2, 0.5, 0.1, 0.4, -0.3}, at::kDouble).view({1, 1, 2, 3});
  at::Tensor mean = at::tensor({1.0, 0.5, 2.0, 1.5}, at::kDouble).view({1, 1, 2, 2});
  at::Tensor x = at::tensor({1.4, 0.1, 2.5, 2.2}, at::kDouble).view({1, 4});
  at::Tensor nearest = at::zeros({1}, at::kLong);

  AnchorPredictions Predictions(const at::Tensor& m, const at::Tensor& n) const {
    const at::Tensor far = at::full({1, 1, 2, 2}, 50.0, at::kDouble);
    const at::Tensor other = at::zeros({1, 1, 2, 3}, at::kDouble);
    return {at::tensor({0.25, 0.75}, at::kDouble).log().view({1, 2}), at::cat({m, far}, 1),
            AnchorCovariance(at::cat({n, other}, 1))};
  }
};

// The bivariate normal as textbooks write it, with deviations and a correlation.
TEST(AnchorLossTest, IsTheNegativeLogOfTheNearestAnchorsGaussians) {
  const HandMade made;
  double expected = -std::log(0.25);
  for (int64_t t = 0; t < 2; ++t) {
    const auto number = [&](int64_t i) { return made.numbers[0][0][t][i].item<double>(); };
    const double sx = 0.05 + std::exp(number(0));
    const double sy = 0.05 + std::exp(number(1));
    const double rho = 0.95 * std::tanh(number(2));
    const double u = (made.x[0][2 * t].item<double>() - made.mean[0][0][t][0].item<double>()) / sx;
    const double v =
        (made.x[0][2 * t + 1].item<double>() - made.mean[0][0][t][1].item<double>()) / sy;
    const double density =
        std::exp(-(u * u - 2.0 * rho * u * v + v * v) / (2.0 * (1.0 - rho * rho))) /
        (2.0 * M_PI * sx * sy * std::sqrt(1.0 - rho * rho));
    expected -= std::log(density);
  }
  const at::Tensor loss =
      MultiPathLoss(made.Predictions(made.mean, made.numbers), made.nearest, made.x);
  EXPECT_NEAR(loss.item<double>(), expected, 1e-12);
}

TEST(AnchorLossTest, ItsGradientIsThatOfFiniteDifferencesAndLeavesOtherAnchorsAlone) {
  const HandMade made;
  for (const bool of_mean : {true, false}) {
    at::Tensor variable = (of_mean ? made.mean : made.numbers).clone().set_requires_grad(true);
    const auto loss = [&](const at::Tensor& v) {
      return MultiPathLoss(
          of_mean ? made.Predictions(v, made.numbers) : made.Predictions(made.mean, v),
          made.nearest, made.x);
    };
    loss(variable).sum().backward();
    const at::Tensor gradient = variable.grad().flatten();
    constexpr double kStep = 1e-6;
    for (int64_t i = 0; i < gradient.numel(); ++i) {
      at::Tensor step = at::zeros({gradient.numel()}, at::kDouble);
      step[i] = kStep;
      step = step.view(variable.sizes());
      const double difference =
          (loss(variable.detach() + step) - loss(variable.detach() - step)).item<double>();
      EXPECT_NEAR(gradient[i].item<double>(), difference / (2.0 * kStep), 1e-6);
    }
  }
  // Hard assignment: the other anchor's Gaussian gets nothing.
  AnchorPredictions predictions = made.Predictions(made.mean, made.numbers);
  predictions.mean = predictions.mean.clone().set_requires_grad(true);
  MultiPathLoss(predictions, made.nearest, made.x).sum().backward();
  EXPECT_EQ(predictions.mean.grad().select(1, 1).abs().sum().item<double>(), 0.0);
}

TEST(AnchorsTest, AnchorsAreCentresOfFamiliesAndExamplesGoToTheNearest) {
  // Families at 10, 20 and 30 m ahead, 1 m either way.
  at::Tensor rows = at::zeros({60, 4}, at::kFloat);
  for (int64_t i = 0; i < 60; ++i) {
    rows[i][0] = 10.0 * static_cast<double>(1 + i % 3);
    rows[i][2] = 10.0 * static_cast<double>(1 + i % 3) + (i < 30 ? 1.0 : -1.0);
    rows[i][3] = 3.0;
  }
  const Anchors anchors = PlaceAnchors(rows, 3, /*mirrored=*/false, 1);
  const at::Tensor ahead = std::get<0>(anchors.mean.select(1, 1).select(1, 0).sort());
  for (int64_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(ahead[k].item<double>(), 10.0 * static_cast<double>(k + 1), 1e-4);
    EXPECT_NEAR(anchors.deviation[k][1][0].item<double>(), 1.0, 1e-4);
  }
  const at::Tensor nearest = NearestAnchor(anchors.mean, rows);
  for (int64_t i = 3; i < 60; ++i) {
    EXPECT_EQ(nearest[i].item<int64_t>(), nearest[i % 3].item<int64_t>());
  }
  const at::Tensor mirrored = PlaceAnchors(rows, 6, /*mirrored=*/true, 1).mean;
  EXPECT_NEAR(mirrored.select(2, 1).sum().item<double>(), 0.0, 1e-3);
}

class BaselinesTest : public testing::Test {
 protected:
  TrainingRun Run(const std::string& name, int epochs) const {
    TrainingRun run;
    run.settings = TinySettings();
    run.settings.mutable_optimization()->set_pretraining_epochs(2);
    run.settings.mutable_optimization()->set_mixture_epochs(1);
    run.settings.mutable_optimization()->set_joint_epochs(epochs);
    run.settings.mutable_optimization()->set_posterior_epochs(0);
    run.output = folder_ / name;
    run.baselines = true;
    return run;
  }

  static std::string ReadBytes(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const TrainingData data_ = *SplitRecordings(ArcRecordings(72), TinySettings());
  const TemporaryFolder folder_;
};

TEST_F(BaselinesTest, BaselinesLearnTheArcsAndHaveRowsInTheMetrics) {
  // Fewer anchors than there are arcs.
  TrainingRun run = Run("model", 15);
  run.settings.mutable_model()->set_actions(3);
  const auto manifest = Train(run, data_);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  const auto& metrics = manifest->metrics();
  for (const char* prefix : {"covernet_", "multipath_"}) {
    for (const char* name :
         {"ade_1", "fde_1", "min_ade_5", "min_ade_6", "min_ade_10", "min_fde_6", "miss_rate_6",
          "miss_rate_nuscenes_1", "miss_rate_waymo_6", "nll", "nll_joint", "calibration_error",
          "effective_actions", "action_perplexity"}) {
      EXPECT_TRUE(metrics.contains(std::string(prefix) + name)) << prefix << name;
    }
    const std::string p = prefix;
    EXPECT_EQ(metrics.at(p + "effective_actions"), 3.0) << p;
    // The lane says which anchor it will be.
    EXPECT_GT(metrics.at(p + "mutual_information"), 0.5) << p;
  }
  EXPECT_LT(metrics.at("multipath_ade_1"), metrics.at("ade_cv"));
  // Offsets bring anchors to the arcs between them, and narrow the Gaussians.
  EXPECT_LT(metrics.at("multipath_min_ade_6"), 0.8 * metrics.at("covernet_min_ade_6"));
  EXPECT_LT(metrics.at("multipath_nll"), metrics.at("covernet_nll"));
}

TEST_F(BaselinesTest, BaselinesDoNotChangeTheModelAndAreReproducible) {
  TrainingRun without = Run("without", 2);
  without.baselines = false;
  ASSERT_TRUE(Train(without, data_).ok());
  ASSERT_TRUE(Train(Run("with", 2), data_).ok());
  ASSERT_TRUE(Train(Run("again", 2), data_).ok());
  TrainingRun other = Run("other", 2);
  other.settings.set_seed(8);
  ASSERT_TRUE(Train(other, data_).ok());
  EXPECT_TRUE(ReadBytes(folder_ / "without" / "weights.safetensors") ==
              ReadBytes(folder_ / "with" / "weights.safetensors"));
  EXPECT_FALSE(fs::exists(folder_ / "without" / "baselines.json"));
  const std::string weights = ReadBytes(folder_ / "with" / "baselines.safetensors");
  EXPECT_FALSE(weights.empty());
  EXPECT_TRUE(weights == ReadBytes(folder_ / "again" / "baselines.safetensors"));
  EXPECT_FALSE(weights == ReadBytes(folder_ / "other" / "baselines.safetensors"));
}

TEST_F(BaselinesTest, ARunStoppedInTheBaselinesEndsWithTheSameBytes) {
  ASSERT_TRUE(Train(Run("whole", 2), data_).ok());
  TrainingRun run = Run("resumed", 2);
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy.interval = std::chrono::milliseconds(0);
  std::set<std::string> stopped_in;
  absl::StatusOr<v1::ModelManifest> manifest;
  for (int stops = 0; stops < 60; ++stops) {
    // Asked before each step.
    int asked = 0;
    std::string phase;
    run.stopped = [&] { return ++asked > 70; };
    run.progress = [&](const v1::JobProgress& progress) { phase = progress.phase(); };
    manifest = Train(run, data_);
    if (manifest.ok()) break;
    ASSERT_EQ(manifest.status().code(), absl::StatusCode::kCancelled);
    stopped_in.insert(phase);
  }
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_TRUE(stopped_in.contains("covernet"));
  EXPECT_TRUE(stopped_in.contains("multipath"));
  for (const char* file : {"weights.safetensors", "baselines.safetensors"}) {
    EXPECT_TRUE(ReadBytes(folder_ / "whole" / file) == ReadBytes(folder_ / "resumed" / file))
        << file;
  }
}

TEST_F(BaselinesTest, ARunThatStartedFromAModelResumesInTheBaselines) {
  ASSERT_TRUE(Train(Run("first", 1), data_).ok());
  const auto prepare = [this](const std::string& name) {
    TrainingRun run = Run(name, 2);
    run.start_from = folder_ / "first";
    return run;
  };
  ASSERT_TRUE(Train(prepare("whole"), data_).ok());
  TrainingRun run = prepare("resumed");
  run.checkpoints = folder_ / "checkpoints";
  run.checkpoint_policy.interval = std::chrono::milliseconds(0);
  std::string phase;
  run.progress = [&](const v1::JobProgress& progress) { phase = progress.phase(); };
  run.stopped = [&] { return phase == "multipath"; };
  ASSERT_EQ(Train(run, data_).status().code(), absl::StatusCode::kCancelled);
  run.stopped = nullptr;
  const absl::Status status = Train(run, data_).status();
  ASSERT_TRUE(status.ok()) << status;
  for (const char* file : {"weights.safetensors", "baselines.safetensors"}) {
    EXPECT_TRUE(ReadBytes(folder_ / "whole" / file) == ReadBytes(folder_ / "resumed" / file))
        << file;
  }
}

// In each phase: the last checkpoint is of the first step of its second epoch.
TEST_F(BaselinesTest, ARunStoppedAtTheStartOfAnEpochEndsWithTheSameBytes) {
  const auto prepare = [this](const std::string& name) {
    TrainingRun run = Run(name, 2);
    run.settings.mutable_optimization()->set_mixture_epochs(2);
    return run;
  };
  ASSERT_TRUE(Train(prepare("whole"), data_).ok());
  for (const std::string phase : {"covernet", "multipath"}) {
    TrainingRun run = prepare(phase);
    run.checkpoints = folder_ / ("checkpoints-" + phase);
    run.checkpoint_policy.interval = std::chrono::milliseconds(0);
    bool first_epoch_is_over = false;
    run.progress = [&](const v1::JobProgress& progress) {
      first_epoch_is_over |= progress.phase() == phase && progress.has_epoch_report();
    };
    run.stopped = [&] { return first_epoch_is_over; };
    ASSERT_EQ(Train(run, data_).status().code(), absl::StatusCode::kCancelled) << phase;
    run.stopped = nullptr;
    ASSERT_TRUE(Train(run, data_).ok()) << phase;
    for (const char* file : {"weights.safetensors", "baselines.safetensors"}) {
      EXPECT_TRUE(ReadBytes(folder_ / "whole" / file) == ReadBytes(folder_ / phase / file))
          << phase << " " << file;
    }
  }
}

TEST_F(BaselinesTest, AlteredBaselinesAreRefusedButTheModelStillServes) {
  ASSERT_TRUE(Train(Run("model", 1), data_).ok());
  const fs::path model = folder_ / "model";
  ASSERT_TRUE(inference::LoadAnchorBaselines(model, {}).ok());
  // A pruned model keeps them.
  fs::create_directories(folder_ / "copy");
  ASSERT_TRUE(artifact::CopyBaselines(model, folder_ / "copy").ok());
  EXPECT_TRUE(ReadBytes(model / "baselines.safetensors") ==
              ReadBytes(folder_ / "copy" / "baselines.safetensors"));

  std::fstream(model / "baselines.safetensors", std::ios::in | std::ios::out | std::ios::binary)
      .seekp(-8, std::ios::end)
      .write("altered!", 8);
  EXPECT_EQ(inference::LoadAnchorBaselines(model, {}).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(artifact::CopyBaselines(model, folder_ / "copy").code(), absl::StatusCode::kDataLoss);
  EXPECT_TRUE(inference::ActionModel::Load(model, {}).ok());
  fs::remove(model / "baselines.safetensors");
  EXPECT_EQ(inference::LoadAnchorBaselines(model, {}).status().code(), absl::StatusCode::kDataLoss);
  fs::remove(model / "baselines.json");
  EXPECT_EQ(inference::LoadAnchorBaselines(model, {}).status().code(), absl::StatusCode::kNotFound);
}

// A baseline of random weights all over: an untrained last layer would say next to nothing.
AnchorNetworks RandomBaseline(const v1::ModelSpec& model, const Anchors& anchors, bool regresses,
                              at::Generator& generator) {
  at::NoGradGuard no_grad;
  AnchorNetworks networks(model, anchors, regresses, at::kCPU, generator);
  for (at::Tensor& parameter : networks.Parameters()) {
    parameter.add_(at::empty_like(parameter).normal_(0.0, 0.1, generator));
  }
  if (regresses) networks.SetScale(at::linspace(0.5, 1.5, 10, at::kFloat));
  networks.SetTemperature(1.7);
  return networks;
}

// Holds what the engine says about a scene against what LibTorch says about example i of a batch.
//   reference: of the scene, [T, 2]
void ExpectAgreement(const AnchorPredictions& expected, int64_t i, const at::Tensor& reference,
                     const inference::SceneEncoding& encoding,
                     const std::vector<inference::ActionDistribution>& actual) {
  for (int64_t k = 0; k < 6; ++k) {
    const auto& own = actual[static_cast<size_t>(k)];
    EXPECT_NEAR(encoding.probabilities[k], expected.log_probabilities[i][k].exp().item<double>(),
                1e-4);
    for (int64_t t = 0; t < 10; ++t) {
      for (int64_t axis = 0; axis < 2; ++axis) {
        const double mean = (expected.mean[i][k][t][axis] + reference[t][axis]).item<double>();
        EXPECT_NEAR(own.moment_mean(t, axis), mean, 1e-4 * (1.0 + std::abs(mean)));
      }
      for (int64_t c = 0; c < 3; ++c) {
        const double covariance = expected.covariance[i][k][t][c].item<double>();
        EXPECT_NEAR(own.moment_covariance(t, c), covariance, 1e-4 * (1.0 + std::abs(covariance)));
      }
    }
  }
}

TEST_F(BaselinesTest, TheEngineAgreesWithLibTorch) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_model()->set_target_motion(true);
  at::Generator generator = MakeGenerator(3);
  const Anchors anchors = PlaceAnchors(Trajectories(data_.training.examples), 6, true, 1);
  const std::vector<SceneLoader::Item> items = DrawItems(data_.validation, 5);
  const v1::RasterSpec& raster = settings.model().raster();
  const SceneSource source(settings.model(), data_.validation, 1);
  SceneLoader loader(settings.model(), source, items, 5, 1);
  SceneLoader::Batch batch = *loader.Next();
  const at::Tensor motions = batch.scenes.motions;
  for (const bool regresses : {false, true}) {
    at::NoGradGuard no_grad;
    AnchorNetworks networks = RandomBaseline(settings.model(), anchors, regresses, generator);
    const AnchorPredictions expected = networks.Predict(batch.scenes, {});
    const auto model = inference::AnchorModel::Make(networks.spec(), networks.Export(),
                                                    {inference::Precision::kF32});
    ASSERT_TRUE(model.ok()) << model.status();
    const auto session = (*model)->NewSession();
    inference::MlpScratch scratch;
    const at::Tensor rasters = batch.scenes.rasters.Dense();
    for (int64_t i = 0; i < 5; ++i) {
      const size_t bytes = scene::RasterBytes(raster);
      const scene::Raster drawn = scene::RasterOf(raster, {rasters[i].data_ptr<uint8_t>(), bytes});
      inference::SceneInputsView scene{&drawn, {}};
      std::copy_n(motions[i].data_ptr<float>(), scene.motion.size(), scene.motion.begin());
      inference::SceneEncoding encoding;
      session->Encode({&scene, 1}, {&encoding, 1});
      ExpectAgreement(expected, i, at::zeros({10, 2}), encoding,
                      (*model)->Describe(encoding, &scratch));
      const at::Tensor x = batch.trajectories;
      const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 2, Eigen::RowMajor>> truth(
          x[i].data_ptr<float>(), 10, 2);
      EXPECT_EQ((*model)->Nearest(encoding, truth.cast<double>()),
                NearestAnchor(networks.anchors(), x)[i].item<int64_t>());
    }
  }
}

// From the recordings on: history, lane paths and agents, with a reference and without.
TEST(VectorBaselinesTest, TheEngineAgreesWithLibTorch) {
  constexpr int64_t kExamples = 6;
  for (const char* preset : {"lanes", "lanes-metres"}) {
    const v1::TrainingSettings settings = TinyLanesSettings(preset);
    const TrainingData data = *SplitRecordings(AmongPedestrians(ArcRecordings(72)), settings);
    at::Generator generator = MakeGenerator(3);
    const Anchors anchors = PlaceAnchors(Trajectories(data.training.examples), 6, true, 1);
    const std::vector<SceneLoader::Item> items = DrawItems(data.validation, kExamples);
    const SceneSource source(settings.model(), data.validation, 1);
    SceneLoader loader(settings.model(), source, items, kExamples, 1);
    const SceneLoader::Batch batch = *loader.Next();
    EXPECT_GT(batch.scenes.path_mask.sum().item<double>(), 0.0);
    EXPECT_GT(batch.scenes.agent_mask.sum().item<double>(), 0.0);
    const at::Tensor references = batch.scenes.references.defined()
                                      ? batch.scenes.references.view({kExamples, 10, 2})
                                      : at::zeros({kExamples, 10, 2});
    EXPECT_EQ(references.abs().max().item<double>() > 1.0, std::string(preset) == "lanes");
    scene::SceneReader reader(settings.model());
    scene::SceneInputs inputs = reader.NewInputs();
    for (const bool regresses : {false, true}) {
      at::NoGradGuard no_grad;
      AnchorNetworks networks = RandomBaseline(settings.model(), anchors, regresses, generator);
      const AnchorPredictions expected = networks.Predict(batch.scenes, {});
      // Scenes differ, or parity would show little.
      EXPECT_GT(expected.log_probabilities.exp().var(0).max().item<double>(), 1e-6);
      const auto model = inference::AnchorModel::Make(networks.spec(), networks.Export(),
                                                      {inference::Precision::kF32});
      ASSERT_TRUE(model.ok()) << model.status();
      const auto session = (*model)->NewSession();
      inference::MlpScratch scratch;
      const at::Tensor nearest = NearestAnchor(networks.anchors(), batch.trajectories);
      for (int64_t i = 0; i < kExamples; ++i) {
        const data::Example& example =
            data.validation.examples[static_cast<size_t>(items[static_cast<size_t>(i)].example)];
        const v1::Scenario& recording =
            data.validation.recordings[static_cast<size_t>(example.recording)];
        reader.Read(recording, scene::RoadMap::Over(recording.map_features()), example.time,
                    example.target_id, example.X_WT, &inputs);
        const inference::SceneInputsView scene = inference::ViewOf(inputs);
        inference::SceneEncoding encoding;
        session->Encode({&scene, 1}, {&encoding, 1});
        ExpectAgreement(expected, i, references[i], encoding,
                        (*model)->Describe(encoding, &scratch));
        const at::Tensor truth = batch.trajectories[i].view({10, 2}) + references[i];
        inference::Trajectory trajectory(10, 2);
        std::copy_n(truth.contiguous().data_ptr<float>(), 20, trajectory.data());
        EXPECT_EQ((*model)->Nearest(encoding, trajectory), nearest[i].item<int64_t>());
      }
    }
  }
}

}  // namespace
}  // namespace maneuver::learning::anchors_test
