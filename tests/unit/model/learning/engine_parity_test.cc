// That the engine says what LibTorch says, of a model that was trained on analytic scenes.

#include <gtest/gtest.h>

#include <chrono>

#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "model/learning/learner.h"
#include "model/learning/moments.h"
#include "model/scene/rasterizer.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::learning {
namespace {

void ExpectClose(const at::Tensor& expected, const Eigen::VectorXd& actual, const char* what) {
  const at::Tensor plain = expected.detach().to(at::kDouble).contiguous().flatten();
  ASSERT_EQ(plain.numel(), actual.size()) << what;
  const Eigen::Map<const Eigen::VectorXd> values(plain.data_ptr<double>(), plain.numel());
  EXPECT_LE((values - actual).norm(), 1e-4 * values.norm() + 1e-7) << what;
}

// Every network of the engine, f32, against LibTorch's.
class EngineParityTest : public testing::TestWithParam<v1::DecoderCovariance> {};

TEST_P(EngineParityTest, TheEngineSaysWhatLibTorchSays) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_optimization()->set_decoder_covariance(GetParam());
  settings = artifact::ResolveTrainingSettings(settings);
  settings.mutable_optimization()->set_pretraining_epochs(4);
  settings.mutable_optimization()->set_mixture_epochs(2);
  settings.mutable_optimization()->set_joint_epochs(2);
  const TrainingData data = *SplitRecordings(ArcRecordings(72), settings);
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
  const auto model = inference::ActionModel::FromStored({manifest, networks.Export()},
                                                        {inference::Precision::kF32});
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
  const at::Tensor own = settings.model().has_decoder_covariance()
                             ? networks.PredictCovariance(posterior.mean)
                             : networks["decoder.covariance"].expand_as(moments.covariance);

  const size_t bytes = scene::RasterBytes(settings.model().raster());
  for (int64_t i = 0; i < kExamples; ++i) {
    const scene::Raster raster = scene::RasterOf(
        settings.model().raster(), {batch.rasters.data() + static_cast<size_t>(i) * bytes, bytes});
    inference::SceneEncoding encoding;
    const inference::SceneInput scene{
        &raster,
        data.validation.examples[static_cast<size_t>(items[static_cast<size_t>(i)].example)]
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
      ExpectClose(moments.covariance[i][k] + own[i][k],
                  Eigen::Map<const Eigen::VectorXd>(actual.moment_covariance.data(),
                                                    actual.moment_covariance.size()),
                  "moment covariance");
    }
    inference::Trajectory trajectory(x.size(1) / 2, 2);
    for (int64_t c = 0; c < x.size(1); ++c) trajectory.data()[c] = x[i][c].item<float>();
    ExpectClose(q_y[i], session->Classify(encoding, trajectory).responsibilities, "q(y|x,s)");
  }
}

INSTANTIATE_TEST_SUITE_P(All, EngineParityTest,
                         testing::Values(v1::DECODER_COVARIANCE_FIXED,
                                         v1::DECODER_COVARIANCE_LEARNED,
                                         v1::DECODER_COVARIANCE_PREDICTED),
                         [](const auto& covariance) {
                           return v1::DecoderCovariance_Name(covariance.param);
                         });

}  // namespace
}  // namespace maneuver::learning
