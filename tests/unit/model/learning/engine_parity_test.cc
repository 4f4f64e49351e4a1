// That the engine says what LibTorch says, of a model that was trained on analytic scenes.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "model/learning/learner.h"
#include "model/learning/moments.h"
#include "model/learning/scene_covariance.h"
#include "model/learning/speed_factors.h"
#include "model/scene/scene_reader.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::engine_parity_test {
namespace {

void ExpectClose(const at::Tensor& expected, const Eigen::VectorXd& actual, const char* what) {
  const at::Tensor plain = expected.detach().to(at::kDouble).contiguous().flatten();
  ASSERT_EQ(plain.numel(), actual.size()) << what;
  const Eigen::Map<const Eigen::VectorXd> values(plain.data_ptr<double>(), plain.numel());
  EXPECT_LE((values - actual).norm(), 1e-4 * values.norm() + 1e-7) << what;
}

// What p(x|z,y,s) adds to the latent covariance, as LibTorch has it. [B, K, T, 3]
at::Tensor OwnCovariance(const Networks& networks, const SceneLoader::Batch& batch,
                         const SceneFeatures& features, const Gaussian& posterior,
                         const WaypointMoments& moments) {
  if (networks.spec().has_scene_covariance()) {
    const SplitCovariance split =
        PredictSceneCovariance(networks, features, moments.mean, batch.scenes.references);
    Predictions predictions;
    predictions.speeds = batch.scenes.speeds;
    predictions.along = split.along;
    predictions.across = split.across;
    return WithSpeedFactors(predictions, networks["scene_covariance.speed_factor"]);
  }
  return networks.spec().has_decoder_covariance()
             ? networks.PredictCovariance(posterior.mean)
             : networks["decoder.covariance"].expand_as(moments.covariance);
}

struct ParityCase {
  const char* name;
  v1::TrainingSettings (*settings)();
};

v1::TrainingSettings RasterSettings(v1::DecoderCovariance covariance) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_optimization()->set_decoder_covariance(covariance);
  return artifact::ResolveTrainingSettings(settings);
}

// Scene vectors beside a raster.
v1::TrainingSettings RasterAndVectorsSettings() {
  v1::TrainingSettings settings = TinyLanesSettings();
  const v1::ModelSpec raster = TinySettings().model();
  *settings.mutable_model()->mutable_raster() = raster.raster();
  *settings.mutable_model()->mutable_backbone() = raster.backbone();
  return settings;
}

// The presets' waypoints, over eight seconds in place of five.
v1::TrainingSettings LongHorizonSettings() {
  v1::TrainingSettings settings = TinyLanesSettings();
  settings.mutable_model()->mutable_trajectory()->set_waypoints(80);
  settings.mutable_model()->mutable_trajectory()->mutable_waypoint_interval()->set_nanos(
      100'000'000);
  return settings;
}

// Actions that look at no lanes, and neither paths nor agents are read.
v1::TrainingSettings HistorySettings() {
  v1::TrainingSettings settings = TinyLanesSettings();
  settings.mutable_model()->mutable_scene_vectors()->set_path_width(0);
  settings.mutable_model()->mutable_scene_vectors()->set_agent_width(0);
  settings.mutable_model()->mutable_action_geometry()->set_pair_width(0);
  return artifact::ResolveTrainingSettings(settings);
}

// Every network of the engine, f32, against LibTorch's.
class EngineParityTest : public testing::TestWithParam<ParityCase> {};

TEST_P(EngineParityTest, TheEngineAgreesWithLibTorch) {
  v1::TrainingSettings settings = GetParam().settings();
  settings.mutable_optimization()->set_pretraining_epochs(4);
  settings.mutable_optimization()->set_mixture_epochs(2);
  settings.mutable_optimization()->set_joint_epochs(2);
  const double horizon = artifact::WaypointTimes(settings.model().trajectory()).back();
  const TrainingData data =
      *SplitRecordings(AmongPedestrians(ArcRecordings(72, std::max(8.0, horizon + 2.0))), settings);
  const auto examples = static_cast<int64_t>(data.training.examples.size());
  TrainingProgress progress(Learner::Plan(settings, {examples, examples, 0}), {},
                            [] { return std::chrono::system_clock::time_point(); });
  RankGroup alone([] { return false; });
  Learner learner(settings, data, at::Device(at::kCPU), 1, alone, progress);
  const absl::Status learned = learner.Learn();
  ASSERT_TRUE(learned.ok()) << learned;
  Networks& networks = learner.state().networks;
  v1::ModelManifest manifest;
  *manifest.mutable_spec() = settings.model();
  const auto model = inference::ActionModel::FromStored({manifest, networks.Export()},
                                                        {inference::Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();
  const auto session = (*model)->NewSession();

  at::NoGradGuard no_grad;
  constexpr int64_t kExamples = 5;
  const std::vector<SceneLoader::Item> items = DrawItems(data.validation, kExamples);
  SceneLoader loader(settings.model(), learner.state().validation, items, kExamples, 1);
  const SceneLoader::Batch batch = *loader.Next();
  const at::Tensor x = batch.trajectories;
  const SceneFeatures features = networks.EncodeScenes(batch.scenes, {});
  const at::Tensor log_p_y = networks.PredictActions(features);
  const Gaussian posterior = networks.EncodeScenarios(features);
  const Gaussian q_z = networks.EncodeTrajectories(x);
  const Gaussian mixture = networks.Mixture();
  const at::Tensor q_y =
      UnifiedLogResponsibilities(
          log_p_y, CrossEntropy({q_z.mean.unsqueeze(1), q_z.log_variance.unsqueeze(1)}, mixture),
          Divergence(posterior, mixture))
          .exp();
  const at::Tensor residual = networks.MeanResidual(features);
  const WaypointMoments moments = LatentMoments(networks, posterior, residual);
  const at::Tensor own = OwnCovariance(networks, batch, features, posterior, moments);
  const at::Tensor reference = batch.scenes.references.unflatten(1, {-1, 2});

  scene::SceneReader reader(settings.model());
  for (int64_t i = 0; i < kExamples; ++i) {
    const data::Example& example =
        data.validation.examples[static_cast<size_t>(items[static_cast<size_t>(i)].example)];
    const v1::Scenario& recording =
        data.validation.recordings[static_cast<size_t>(example.recording)];
    scene::SceneInputs inputs = reader.NewInputs();
    reader.Read(recording, scene::RoadMap::Over(recording.map_features()), example.time,
                example.target_id, example.X_WT, &inputs);
    inference::SceneEncoding encoding;
    const inference::SceneInputsView scene = inference::ViewOf(inputs);
    session->Encode({&scene, 1}, {&encoding, 1});
    ExpectClose(features.features[i], encoding.features.cast<double>(), "features");
    ExpectClose(log_p_y[i].exp(), encoding.probabilities, "p(y|s)");
    if (features.geometry.defined()) {
      ExpectClose(
          features.geometry[i],
          Eigen::Map<const Eigen::VectorXf>(encoding.geometry.data(), encoding.geometry.size())
              .cast<double>(),
          "h_y");
    }
    const std::vector<int> actions = {4, 0};
    const auto distributions =
        session->Describe(encoding, actions, inference::LatentSource::kPosterior);
    for (size_t j = 0; j < actions.size(); ++j) {
      const int64_t k = actions[j];
      const inference::ActionDistribution& actual = distributions[j];
      ExpectClose(posterior.mean[i][k], actual.latent_mean, "mean of q(z|y,s)");
      ExpectClose((0.5 * posterior.log_variance[i][k]).exp(), actual.latent_stddev,
                  "deviation of q(z|y,s)");
      ExpectClose(networks.Decode(posterior.mean[i][k],
                                  residual.defined() ? residual[i][k] : at::Tensor()) +
                      batch.scenes.references[i],
                  Eigen::Map<const Eigen::VectorXd>(actual.mean().data(), actual.mean().size()),
                  "mean trajectory");
      ExpectClose(
          moments.mean[i][k] + reference[i],
          Eigen::Map<const Eigen::VectorXd>(actual.moment_mean.data(), actual.moment_mean.size()),
          "moment mean");
      ExpectClose(moments.covariance[i][k] + own[i][k],
                  Eigen::Map<const Eigen::VectorXd>(actual.moment_covariance.data(),
                                                    actual.moment_covariance.size()),
                  "moment covariance");
    }
    inference::Trajectory trajectory(x.size(1) / 2, 2);
    for (int64_t c = 0; c < x.size(1); ++c) {
      trajectory.data()[c] = x[i][c].item<float>() + batch.scenes.references[i][c].item<float>();
    }
    ExpectClose(q_y[i], session->Classify(encoding, trajectory).responsibilities, "q(y|x,s)");
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, EngineParityTest,
    testing::Values(
        ParityCase{"Fixed", [] { return RasterSettings(v1::DECODER_COVARIANCE_FIXED); }},
        ParityCase{"Learned", [] { return RasterSettings(v1::DECODER_COVARIANCE_LEARNED); }},
        ParityCase{"Predicted", [] { return RasterSettings(v1::DECODER_COVARIANCE_PREDICTED); }},
        ParityCase{"Lanes", [] { return TinyLanesSettings(); }},
        ParityCase{"History", &HistorySettings},
        ParityCase{"LanesOver8Seconds", &LongHorizonSettings},
        ParityCase{"LanesMetres", [] { return TinyLanesSettings("lanes-metres"); }},
        ParityCase{"RasterAndVectors", &RasterAndVectorsSettings}),
    [](const auto& parity) { return std::string(parity.param.name); });

}  // namespace
}  // namespace maneuver::learning::engine_parity_test
