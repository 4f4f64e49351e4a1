#include "model/inference/action_model.h"

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <numbers>
#include <random>
#include <thread>

#include "model/inference/backbone.h"
#include "tests/unit/model/inference/answers.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/scene/raster_of.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::inference::action_model_test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using Rasters = std::vector<std::vector<uint8_t>>;

// Odd sizes, both strides, channels that fill no vector.
v1::ModelSpec SmallSpec() {
  v1::ModelSpec spec;
  google::protobuf::TextFormat::ParseFromString(
      R"pb(
        raster {
          height: 37
          width: 30
          meters_per_pixel: 1
          target_position: 0.3
          history_frames: 3
          frame_interval { nanos: 500000000 }
        }
        backbone {
          convolutions { channels: 12 stride: 2 }
          convolutions { channels: 16 stride: 1 }
          convolutions { channels: 21 stride: 2 }
          features: 40
        }
        trajectory {
          waypoints: 7
          waypoint_interval { nanos: 500000000 }
        }
        actions: 6
        latent_dimensions: 3
        action_predictor { hidden: [ 24, 20 ] }
        trajectory_encoder { hidden: [ 33 ] }
        decoder { hidden: [ 18, 19, 20 ] }
        scenario_encoder { hidden: [ 22, 17 ] }
        decoder_stddev: 0.8
      )pb",
      &spec);
  return spec;
}

class ActionModelTest : public testing::Test {
 protected:
  void SetUp() override {
    stored_ = RandomModel(SmallSpec(), 5);
    ASSERT_TRUE(artifact::WriteModelFolder(folder_, stored_).ok());
    model_ = Load();
    session_ = model_->NewSession();
  }

  std::shared_ptr<const ActionModel> Load() {
    auto model = ActionModel::Load(folder_, {.precision = Precision::kF32});
    EXPECT_TRUE(model.ok()) << model.status();
    return *std::move(model);
  }

  std::vector<SceneEncoding> Encode(InferenceSession* session, const Rasters& rasters) {
    std::vector<SceneInputsView> scenes;
    std::deque<scene::Raster> drawn;
    for (const auto& raster : rasters) {
      drawn.push_back(scene::RasterOf(SmallSpec().raster(), raster));
      scenes.push_back({&drawn.back(), {}});
    }
    std::vector<SceneEncoding> encodings(rasters.size());
    session->Encode(scenes, encodings);
    return encodings;
  }

  SceneEncoding EncodeOne(uint32_t seed) {
    return Encode(session_.get(), {RandomRaster(SmallSpec(), seed)})[0];
  }

  Trajectory RandomTrajectory(uint32_t seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    Trajectory trajectory(7, 2);
    for (Eigen::Index i = 0; i < trajectory.size(); ++i) trajectory.data()[i] = normal(random);
    return trajectory;
  }

  const TemporaryFolder parent_;
  const fs::path folder_ = parent_ / "model";
  artifact::StoredModel stored_;
  std::shared_ptr<const ActionModel> model_;
  std::unique_ptr<InferenceSession> session_;
};

TEST_F(ActionModelTest, EncodesAsTheReferenceDoes) {
  const ReferenceModel reference(stored_);
  for (uint32_t seed = 0; seed < 4; ++seed) {
    const auto raster = RandomRaster(SmallSpec(), seed);
    const SceneEncoding encoding = Encode(session_.get(), {raster})[0];
    const auto features = reference.Features(raster);
    ExpectNear(Doubles(encoding.features.cast<double>().eval()), features, 1e-5, "features");
    ExpectNear(Doubles(encoding.probabilities), reference.Probabilities({features}), 1e-5,
               "p(y|s)");
    EXPECT_NEAR(encoding.probabilities.sum(), 1.0, 1e-9);
    EXPECT_EQ(encoding.geometry.size(), 0);
    EXPECT_EQ(encoding.reference.size(), 0);
  }
}

TEST_F(ActionModelTest, DescribesAsTheReferenceDoes) {
  const ReferenceModel reference(stored_);
  const auto raster = RandomRaster(SmallSpec(), 1);
  const SceneEncoding encoding = Encode(session_.get(), {raster})[0];
  const auto features = reference.Features(raster);
  const std::vector<int> actions = {4, 0, 5};
  const auto distributions = session_->Describe(encoding, actions, LatentSource::kPosterior);
  ASSERT_EQ(distributions.size(), actions.size());
  for (size_t i = 0; i < actions.size(); ++i) {
    const ActionDistribution& distribution = distributions[i];
    EXPECT_EQ(distribution.action, actions[i]);
    const auto posterior = reference.Posterior({features}, actions[i]);
    std::vector<double> mean(posterior.begin(), posterior.begin() + 3), stddev;
    for (size_t d = 3; d < 6; ++d) stddev.push_back(std::exp(posterior[d] / 2));
    ExpectNear(Doubles(distribution.latent_mean), mean, 1e-5, "latent mean");
    ExpectNear(Doubles(distribution.latent_stddev), stddev, 1e-5, "latent stddev");
    ASSERT_EQ(distribution.sigma.size(), 7u);
    for (size_t p = 0; p < 7; ++p) {
      auto z = mean;
      if (p > 0) z[(p - 1) / 2] += (p % 2 == 1 ? 1 : -1) * stddev[(p - 1) / 2];
      ExpectNear(Doubles(distribution.sigma[p]), reference.Decode(z), 1e-5, "sigma trajectory");
    }
  }
}

TEST_F(ActionModelTest, MomentsAddTheDecodersCovariance) {
  const SceneEncoding encoding = EncodeOne(2);
  const int actions[] = {3};
  const auto distribution = session_->Describe(encoding, actions, LatentSource::kPosterior).front();
  const auto& own = stored_.weights.at("decoder.covariance").values;
  for (Eigen::Index t = 0; t < 7; ++t) {
    Eigen::Matrix2d latent = Eigen::Matrix2d::Zero();
    Eigen::Vector2d mean = distribution.sigma[0].row(t);
    for (size_t d = 0; d < 3; ++d) {
      const Eigen::Vector2d plus = distribution.sigma[1 + 2 * d].row(t);
      const Eigen::Vector2d minus = distribution.sigma[2 + 2 * d].row(t);
      latent += (plus - minus) * (plus - minus).transpose() / 4;
      mean += (plus + minus) / 2 - distribution.sigma[0].row(t).transpose();
    }
    const size_t row = static_cast<size_t>(3 * 7 + t) * 3;
    EXPECT_NEAR(distribution.moment_covariance(t, 0), latent(0, 0) + own[row], 1e-9);
    EXPECT_NEAR(distribution.moment_covariance(t, 1), latent(0, 1) + own[row + 1], 1e-9);
    EXPECT_NEAR(distribution.moment_covariance(t, 2), latent(1, 1) + own[row + 2], 1e-9);
    EXPECT_NEAR(distribution.moment_mean(t, 0), mean.x(), 1e-9);
    EXPECT_NEAR(distribution.moment_mean(t, 1), mean.y(), 1e-9);
  }
}

// The covariance as a function of the latent, by hand: one ReLU layer, then the factor L.
TEST_F(ActionModelTest, MomentsAddTheCovarianceThatTheLatentPredicts) {
  v1::ModelSpec spec = SmallSpec();
  spec.mutable_decoder_covariance()->add_hidden(5);
  stored_ = RandomModel(spec, 6);
  ASSERT_FALSE(stored_.weights.contains("decoder.covariance"));
  stored_.weights.at("decoder_covariance.1.bias").values[3 * 6] = -9.0f;  // below the bounds
  fs::remove_all(folder_);
  ASSERT_TRUE(artifact::WriteModelFolder(folder_, stored_).ok());
  model_ = Load();
  session_ = model_->NewSession();
  const auto& w0 = stored_.weights.at("decoder_covariance.0.weight").values;
  const auto& b0 = stored_.weights.at("decoder_covariance.0.bias").values;
  const auto& w1 = stored_.weights.at("decoder_covariance.1.weight").values;
  const auto& b1 = stored_.weights.at("decoder_covariance.1.bias").values;
  const int actions[] = {3, 1};
  for (const LatentSource source : {LatentSource::kPosterior, LatentSource::kPrior}) {
    for (const auto& distribution : session_->Describe(EncodeOne(2), actions, source)) {
      std::vector<double> hidden;
      for (size_t h = 0; h < 5; ++h) {
        double sum = b0[h];
        for (size_t d = 0; d < 3; ++d) {
          sum += w0[3 * h + d] * distribution.latent_mean[static_cast<Eigen::Index>(d)];
        }
        hidden.push_back(std::max(0.0, sum));
      }
      for (size_t t = 0; t < 7; ++t) {
        double factor[3];
        for (size_t o = 0; o < 3; ++o) {
          factor[o] = b1[3 * t + o];
          for (size_t h = 0; h < 5; ++h) factor[o] += w1[5 * (3 * t + o) + h] * hidden[h];
        }
        Eigen::Matrix2d L;
        L << std::exp(std::max(-3.0, factor[0])), 0.0, factor[2] * std::exp(factor[1]),
            std::exp(factor[1]);
        Eigen::Matrix2d expected = L * L.transpose();
        const auto row = static_cast<Eigen::Index>(t);
        for (size_t d = 0; d < 3; ++d) {
          const Eigen::Vector2d half =
              (distribution.sigma[1 + 2 * d].row(row) - distribution.sigma[2 + 2 * d].row(row)) / 2;
          expected += half * half.transpose();
        }
        const double tolerance = 1e-6 * expected.trace();
        EXPECT_NEAR(distribution.moment_covariance(row, 0), expected(0, 0), tolerance);
        EXPECT_NEAR(distribution.moment_covariance(row, 1), expected(0, 1), tolerance);
        EXPECT_NEAR(distribution.moment_covariance(row, 2), expected(1, 1), tolerance);
      }
    }
  }
}

TEST_F(ActionModelTest, ThePriorDoesNotDependOnTheScene) {
  const int actions[] = {2};
  const auto here = session_->Describe(EncodeOne(3), actions, LatentSource::kPrior).front();
  const auto there = session_->Describe(EncodeOne(4), actions, LatentSource::kPrior).front();
  EXPECT_TRUE(SameBits(here, there));
  const auto& mean = stored_.weights.at("mixture.mean").values;
  const auto& log_variance = stored_.weights.at("mixture.log_variance").values;
  for (size_t d = 0; d < 3; ++d) {
    const auto i = static_cast<Eigen::Index>(d);
    EXPECT_NEAR(here.latent_mean[i], mean[2 * 3 + d], 1e-12);
    EXPECT_NEAR(here.latent_stddev[i], std::exp(0.5 * log_variance[2 * 3 + d]), 1e-9);
  }
}

TEST_F(ActionModelTest, ClassifiesAsBruteForceNormalisationDoes) {
  const ReferenceModel reference(stored_);
  for (uint32_t seed = 0; seed < 4; ++seed) {
    const auto raster = RandomRaster(SmallSpec(), seed);
    const Trajectory trajectory = RandomTrajectory(seed);
    const auto classification = session_->Classify(Encode(session_.get(), {raster})[0], trajectory);
    EXPECT_NEAR(classification.responsibilities.sum(), 1.0, 1e-12);
    ExpectNear(Doubles(classification.responsibilities),
               reference.Responsibilities({reference.Features(raster)}, Doubles(trajectory)), 1e-4,
               "q(y|x,s)");
  }
}

TEST_F(ActionModelTest, AnswersHaveTheSameBitsAloneAndInAnyBatch) {
  std::mt19937 random(9);
  Rasters rasters;
  std::vector<SceneEncoding> alone;
  for (uint32_t seed = 0; seed < 17; ++seed) {
    rasters.push_back(RandomRaster(SmallSpec(), seed));
    alone.push_back(Encode(session_.get(), {rasters.back()})[0]);
  }
  for (size_t size = 1; size <= rasters.size(); ++size) {
    std::vector<size_t> order(rasters.size());
    for (size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::shuffle(order.begin(), order.end(), random);
    Rasters batch;
    for (size_t i = 0; i < size; ++i) batch.push_back(rasters[order[i]]);
    const auto encodings = Encode(session_.get(), batch);
    for (size_t i = 0; i < size; ++i) {
      ASSERT_TRUE(SameBits(encodings[i], alone[order[i]])) << "batch of " << size;
    }
  }
}

TEST_F(ActionModelTest, AnActionHasTheSameBitsWhateverElseIsRequested) {
  const SceneEncoding encoding = EncodeOne(6);
  for (const LatentSource source : {LatentSource::kPosterior, LatentSource::kPrior}) {
    const int all[] = {5, 4, 3, 2, 1, 0};
    const auto together = session_->Describe(encoding, all, source);
    for (size_t i = 0; i < together.size(); ++i) {
      const int one[] = {all[i]};
      EXPECT_TRUE(SameBits(together[i], session_->Describe(encoding, one, source).front()));
    }
  }
}

TEST_F(ActionModelTest, MeanTrajectoriesHaveTheBitsOfTheirDistributions) {
  const SceneEncoding encoding = EncodeOne(6);
  for (const LatentSource source : {LatentSource::kPosterior, LatentSource::kPrior}) {
    const int actions[] = {4, 0, 5};
    const TrajectorySet means = session_->MeanTrajectories(encoding, actions, source);
    const auto described = session_->Describe(encoding, actions, source);
    ASSERT_EQ(means.size(), described.size());
    for (size_t i = 0; i < means.size(); ++i) {
      EXPECT_TRUE(SameBits(means[i], described[i].mean()));
    }
  }
}

// The reference and the residual of the mean are in both.
TEST_F(ActionModelTest, MeanTrajectoriesOfARelativeModelHaveTheBitsOfTheirDistributions) {
  v1::ModelSpec spec = SmallSpec();
  spec.clear_raster();
  spec.clear_backbone();
  spec.mutable_scene_vectors()->set_history_width(8);
  spec.mutable_scene_vectors()->set_features(12);
  spec.set_reference(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  spec.set_mean_residual(true);
  const auto model = ActionModel::FromStored(RandomModel(spec, 7), {.precision = Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();
  const auto session = (*model)->NewSession();
  scene::SceneVectors vectors;
  vectors.motion.speed = 10.0;
  vectors.history.fill(0.5f);
  const SceneInputsView scene{.raster = nullptr, .motion = {}, .vectors = &vectors};
  SceneEncoding encoding;
  session->Encode({&scene, 1}, {&encoding, 1});
  for (const LatentSource source : {LatentSource::kPosterior, LatentSource::kPrior}) {
    const int actions[] = {4, 0, 5};
    const TrajectorySet means = session->MeanTrajectories(encoding, actions, source);
    const auto described = session->Describe(encoding, actions, source);
    for (size_t i = 0; i < described.size(); ++i) {
      EXPECT_TRUE(SameBits(means[i], described[i].mean()));
    }
  }
}

TEST_F(ActionModelTest, DescribesNothingIfNoActionIsRequested) {
  const SceneEncoding encoding = EncodeOne(6);
  for (const LatentSource source : {LatentSource::kPosterior, LatentSource::kPrior}) {
    EXPECT_TRUE(session_->MeanTrajectories(encoding, {}, source).empty());
    EXPECT_TRUE(session_->Describe(encoding, {}, source).empty());
  }
}

TEST_F(ActionModelTest, AnswersHaveTheSameBitsAfterARestart) {
  const auto again = Load()->NewSession();
  const Rasters rasters = {RandomRaster(SmallSpec(), 7)};
  const SceneEncoding before = Encode(session_.get(), rasters)[0];
  const SceneEncoding after = Encode(again.get(), rasters)[0];
  EXPECT_TRUE(SameBits(before, after));
  const Trajectory trajectory = RandomTrajectory(7);
  EXPECT_TRUE(SameBits(session_->Classify(before, trajectory).responsibilities,
                       again->Classify(after, trajectory).responsibilities));
}

TEST_F(ActionModelTest, SessionsOnSeveralThreadsDoNotDisturbEachOther) {
  const Rasters rasters = {RandomRaster(SmallSpec(), 8), RandomRaster(SmallSpec(), 9)};
  const auto expected = Encode(session_.get(), rasters);
  std::vector<int> wrong(4, 0);
  std::vector<std::thread> threads;
  for (int& count : wrong) {
    threads.emplace_back([&, this] {
      const auto session = model_->NewSession();
      for (int i = 0; i < 50; ++i) {
        const auto encodings = Encode(session.get(), rasters);
        for (size_t r = 0; r < rasters.size(); ++r) count += !SameBits(encodings[r], expected[r]);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(wrong, testing::Each(0));
}

TEST_F(ActionModelTest, ASessionKeepsItsModelAlive) {
  const SceneEncoding before = EncodeOne(10);
  model_.reset();
  EXPECT_TRUE(SameBits(EncodeOne(10), before));
}

TEST_F(ActionModelTest, ActionSetIsTheDecodedPrior) {
  const double usage[] = {0.1, 0.2, 0.3, 0.2, 0.1, 0.1};
  const bool effective[] = {true, true, false, true, true, true};
  const auto actions = DecodeActionSet(*model_, usage, effective);
  ASSERT_EQ(actions.size(), 6u);
  const ReferenceModel reference(stored_);
  for (size_t k = 0; k < actions.size(); ++k) {
    EXPECT_EQ(actions[k].action_id(), static_cast<int>(k));
    EXPECT_EQ(actions[k].usage(), usage[k]);
    EXPECT_EQ(actions[k].effective(), effective[k]);
    const v1::ActionDistribution& distribution = actions[k].distribution();
    EXPECT_EQ(distribution.action_id(), static_cast<int>(k));
    EXPECT_EQ(distribution.probability(), usage[k]);
    EXPECT_EQ(distribution.sigma_trajectories_size(), 7);
    EXPECT_EQ(distribution.moments().covariance_xy_size(), 7);
    const auto& means = stored_.weights.at("mixture.mean").values;
    const auto expected = reference.Decode({means[k * 3], means[k * 3 + 1], means[k * 3 + 2]});
    for (int t = 0; t < 7; ++t) {
      const size_t at = static_cast<size_t>(2 * t);
      EXPECT_NEAR(distribution.mean_trajectory().x(t), expected[at], 1e-4);
      EXPECT_NEAR(distribution.mean_trajectory().y(t), expected[at + 1], 1e-4);
    }
  }
}

TEST_F(ActionModelTest, RefusesADamagedFolderWithTheReason) {
  const fs::path weights = folder_ / "weights.safetensors";
  fs::resize_file(weights, fs::file_size(weights) - 1);
  const auto model = ActionModel::Load(folder_, {});
  EXPECT_EQ(model.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(model.status().message()), HasSubstr("truncated or altered"));
  EXPECT_TRUE(SameBits(EncodeOne(1), EncodeOne(1)));  // what is in memory goes on
}

TEST_F(ActionModelTest, UsesBf16OnlyIfTheProcessorSupportsIt) {
  const auto automatic = ActionModel::Load(folder_, {.precision = Precision::kAuto});
  ASSERT_TRUE(automatic.ok());
  EXPECT_EQ((*automatic)->precision(), ProcessorHasBf16() ? "bf16" : "f32");
  const auto bf16 = ActionModel::Load(folder_, {.precision = Precision::kBf16});
  if (!ProcessorHasBf16()) {
    EXPECT_EQ(bf16.status().code(), absl::StatusCode::kFailedPrecondition);
    return;
  }
  ASSERT_TRUE(bf16.ok()) << bf16.status();
  const Rasters raster = {RandomRaster(SmallSpec(), 1)};
  const auto rough = Encode((*bf16)->NewSession().get(), raster)[0];
  const auto exact = Encode(session_.get(), raster)[0];
  EXPECT_LT((rough.probabilities - exact.probabilities).cwiseAbs().maxCoeff(), 0.01);
}

}  // namespace
}  // namespace maneuver::inference::action_model_test
