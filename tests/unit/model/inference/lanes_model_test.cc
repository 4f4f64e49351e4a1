// Models that read vectors, look at the lanes and predict relative to the motion, against the
// reference's plain loops.

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "model/artifact/model_spec.h"
#include "model/artifact/model_weights.h"
#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "model/inference/backbone.h"
#include "model/inference/packed_networks.h"
#include "model/probability/latent_mixture.h"
#include "tests/unit/model/inference/answers.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::inference::lanes_model_test {
namespace {

constexpr double kTolerance = 1e-4;
constexpr int kScenes = 7;  // of 0 .. 6 lane paths and 0 .. 12 agents

v1::ModelSpec SpecOfPreset(const std::string& preset) {
  v1::TrainingSettings settings;
  settings.set_preset(preset);
  return artifact::ResolveTrainingSettings(settings).model();
}

// Odd sizes that fill no vector.
v1::ModelSpec SmallSpec(const std::string& more) {
  v1::ModelSpec spec;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(
      R"pb(
            trajectory {
              waypoints: 11
              waypoint_interval { nanos: 300000000 }
            }
            actions: 5
            latent_dimensions: 3
            action_predictor { hidden: 13 }
            trajectory_encoder { hidden: 21 }
            decoder { hidden: [ 18, 19 ] }
            scenario_encoder { hidden: 17 }
            decoder_stddev: 0.8
      )pb" +
          more,
      &spec));
  return spec;
}

constexpr char kRaster[] = R"pb(
  raster {
    height: 32
    width: 32
    meters_per_pixel: 2
    target_position: 0.3
    history_frames: 2
    frame_interval { nanos: 500000000 }
  }
  backbone {
    convolutions { channels: 5 stride: 2 }
    convolutions { channels: 9 stride: 2 }
    features: 14
  }
)pb";

struct Case {
  const char* name;
  v1::ModelSpec spec;
};

std::vector<Case> Cases() {
  return {
      {"Lanes", SpecOfPreset("lanes")},
      {"LanesMetres", SpecOfPreset("lanes-metres")},
      {"RasterBesideEverything", SmallSpec(std::string(kRaster) + R"pb(
         reference: TRAJECTORY_REFERENCE_FADING_MOTION
         scene_vectors {
           history_width: 7
           path_width: 15
           attention_heads: 3
           features: 23
           agent_width: 14
           agent_heads: 2
         }
         action_geometry { pair_width: 10 attention_heads: 5 features: 11 }
         mean_residual: true
         scene_covariance { hidden: [ 6, 7 ] }
       )pb")},
      {"HistoryAlone", SmallSpec(R"pb(
         reference: TRAJECTORY_REFERENCE_CONSTANT_VELOCITY
         scene_vectors { history_width: 9 features: 12 }
         mean_residual: true
       )pb")},
      {"AgentsWithoutPaths", SmallSpec(R"pb(
         reference: TRAJECTORY_REFERENCE_FADING_MOTION
         scene_vectors { history_width: 9 features: 12 agent_width: 10 agent_heads: 5 }
         mean_residual: true
       )pb")},
      {"PathsWithoutGeometry", SmallSpec(std::string(kRaster) + R"pb(
         scene_vectors { history_width: 9 path_width: 8 attention_heads: 1 features: 12 }
         decoder_covariance { hidden: 5 }
       )pb")},
  };
}

class LanesModelTest : public testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    stored_ = RandomModel(spec(), 3);
    auto model = ActionModel::FromStored(stored_, {.precision = Precision::kF32});
    ASSERT_TRUE(model.ok()) << model.status();
    model_ = *std::move(model);
    session_ = model_->NewSession();
    for (int s = 0; s < kScenes; ++s) {
      const auto seed = static_cast<uint32_t>(s + 1);
      vectors_.push_back(RandomVectors(seed, artifact::ReadsLanePaths(spec()) ? s : 0,
                                       artifact::ReadsAgents(spec()) ? 2 * s : 0));
      SceneInputsView& input = inputs_.emplace_back();
      input.vectors = &vectors_.back();
      std::vector<double> raster_features;
      if (spec().has_raster()) {
        const auto raster = RandomRaster(spec(), seed);
        rasters_.push_back(scene::RasterOf(spec().raster(), raster));
        input.raster = &rasters_.back();
        raster_features = reference_.Features(raster);
      }
      expected_.push_back(reference_.Encode(vectors_.back(), raster_features));
    }
    encodings_.resize(inputs_.size());
    session_->Encode(inputs_, encodings_);
  }

  const v1::ModelSpec& spec() const { return GetParam().spec; }
  std::vector<int> AllActions() const {
    std::vector<int> actions(static_cast<size_t>(spec().actions()));
    std::iota(actions.begin(), actions.end(), 0);
    return actions;
  }

  // Holds a distribution against what its latent decodes to, moved by `shift`.
  void ExpectTrajectories(const ActionDistribution& distribution,
                          const ReferenceModel::Scene& scene, const std::vector<double>& shift) {
    const size_t D = static_cast<size_t>(spec().latent_dimensions());
    std::vector<std::vector<double>> images;
    for (size_t p = 0; p < 2 * D + 1; ++p) {
      std::vector<double> z = Doubles(distribution.latent_mean);
      if (p > 0) {
        const size_t d = (p - 1) / 2;
        z[d] += (p % 2 == 1 ? 1 : -1) * distribution.latent_stddev[static_cast<Eigen::Index>(d)];
      }
      images.push_back(reference_.Decode(z));
      for (size_t i = 0; i < shift.size(); ++i) images[p][i] += shift[i];
      ExpectNear(Doubles(distribution.sigma[p]), images[p], kTolerance, "sigma trajectory");
    }
    // mean = x_0 + sum of half the second differences; covariance = sum of h h^T and p(x|z)'s own.
    std::vector<double> mean = images[0];
    for (size_t i = 0; i < mean.size(); ++i) {
      for (size_t d = 0; d < D; ++d) {
        mean[i] += 0.5 * (images[1 + 2 * d][i] + images[2 + 2 * d][i]) - images[0][i];
      }
    }
    ExpectNear(Doubles(distribution.moment_mean), mean, kTolerance, "moment mean");
    if (!spec().has_scene_covariance()) return;  // as action_model_test.cc has it
    const auto own =
        reference_.SceneCovariance(scene, distribution.action, Doubles(distribution.moment_mean));
    std::vector<double> covariance;
    for (size_t t = 0; t < own.size(); ++t) {
      double xx = own[t][0], xy = own[t][1], yy = own[t][2];
      for (size_t d = 0; d < D; ++d) {
        const double x = (images[1 + 2 * d][2 * t] - images[2 + 2 * d][2 * t]) / 2;
        const double y = (images[1 + 2 * d][2 * t + 1] - images[2 + 2 * d][2 * t + 1]) / 2;
        xx += x * x;
        xy += x * y;
        yy += y * y;
      }
      covariance.insert(covariance.end(), {xx, xy, yy});
    }
    ExpectNear(Doubles(distribution.moment_covariance), covariance, kTolerance, "covariance");
  }

  artifact::StoredModel stored_;
  const ReferenceModel reference_{stored_};
  std::shared_ptr<const ActionModel> model_;
  std::unique_ptr<InferenceSession> session_;
  std::deque<scene::SceneVectors> vectors_;
  std::deque<scene::Raster> rasters_;
  std::vector<SceneInputsView> inputs_;
  std::vector<ReferenceModel::Scene> expected_;
  std::vector<SceneEncoding> encodings_;
};

TEST_P(LanesModelTest, EncodesAsTheReferenceDoes) {
  for (size_t s = 0; s < kScenes; ++s) {
    const SceneEncoding& encoding = encodings_[s];
    const ReferenceModel::Scene& expected = expected_[s];
    ExpectNear(Doubles(encoding.features.cast<double>().eval()), expected.features, kTolerance,
               "features");
    ExpectNear(Doubles(encoding.probabilities), reference_.Probabilities(expected), kTolerance,
               "p(y|s)");
    EXPECT_NEAR(encoding.probabilities.sum(), 1.0, 1e-9);
    EXPECT_EQ(encoding.speed, vectors_[s].motion.speed);
    ASSERT_EQ(encoding.geometry.rows(), static_cast<Eigen::Index>(expected.geometry.size()));
    for (Eigen::Index k = 0; k < encoding.geometry.rows(); ++k) {
      ExpectNear(Doubles(encoding.geometry.row(k).cast<double>().eval()),
                 expected.geometry[static_cast<size_t>(k)], kTolerance, "h_y");
    }
    if (artifact::HasReference(spec())) {
      ExpectNear(Doubles(encoding.reference), expected.reference, 1e-12, "reference");
    } else {
      EXPECT_EQ(encoding.reference.size(), 0);
    }
  }
}

TEST_P(LanesModelTest, DescribesThePosteriorAsTheReferenceDoes) {
  const size_t D = static_cast<size_t>(spec().latent_dimensions());
  for (size_t s = 0; s < kScenes; ++s) {
    const std::vector<int> actions = {4, 0, 2};
    for (const ActionDistribution& distribution :
         session_->Describe(encodings_[s], actions, LatentSource::kPosterior)) {
      const auto posterior = reference_.Posterior(expected_[s], distribution.action);
      std::vector<double> log_variance = Doubles(distribution.latent_stddev);
      for (double& value : log_variance) value = 2 * std::log(value);
      const auto middle = posterior.begin() + static_cast<std::ptrdiff_t>(D);
      ExpectNear(Doubles(distribution.latent_mean), {posterior.begin(), middle}, kTolerance,
                 "latent mean");
      ExpectNear(log_variance, {middle, posterior.end()}, kTolerance, "latent log-variance");
      std::vector<double> shift = expected_[s].reference;
      if (spec().mean_residual()) {
        const auto residual = reference_.MeanResidual(expected_[s], distribution.action);
        for (size_t i = 0; i < shift.size(); ++i) shift[i] += residual[i];
      }
      ExpectTrajectories(distribution, expected_[s], shift);
    }
  }
}

TEST_P(LanesModelTest, DescribesThePriorWithTheReferenceAndWithoutTheResidual) {
  const std::vector<int> actions = {1, 3};
  const auto distributions = session_->Describe(encodings_[5], actions, LatentSource::kPrior);
  for (const ActionDistribution& distribution : distributions) {
    for (Eigen::Index d = 0; d < spec().latent_dimensions(); ++d) {
      const auto i = static_cast<size_t>(distribution.action * spec().latent_dimensions() + d);
      EXPECT_EQ(distribution.latent_mean[d], stored_.weights.at("mixture.mean").values[i]);
    }
    ExpectTrajectories(distribution, expected_[5], expected_[5].reference);
  }
}

TEST_P(LanesModelTest, GenericActionsOfStraightDrivingFollowItsReference) {
  for (const double speed : {0.0, 12.0}) {
    ReferenceModel::Scene scene;
    scene.features.assign(static_cast<size_t>(artifact::SceneFeatureCount(spec())), 0.0);
    scene.speed = speed;
    for (const double time : artifact::WaypointTimes(spec().trajectory())) {
      scene.reference.push_back(artifact::HasReference(spec()) ? speed * time : 0.0);
      scene.reference.push_back(0.0);
    }
    const std::vector<int> actions = AllActions();
    const auto distributions =
        session_->Describe(DrivingStraight(spec(), speed), actions, LatentSource::kPrior);
    for (const ActionDistribution& distribution : distributions) {
      ExpectTrajectories(distribution, scene, scene.reference);
    }
    const std::vector<double> usage(actions.size(), 0.2);
    const std::vector<char> effective(actions.size(), 1);
    const auto action_set = DecodeActionSet(
        *model_, usage, {reinterpret_cast<const bool*>(effective.data()), effective.size()}, speed);
    for (size_t k = 0; k < actions.size(); ++k) {
      EXPECT_EQ(action_set[k].distribution().mean_trajectory().x(3), distributions[k].mean()(3, 0));
    }
  }
}

TEST_P(LanesModelTest, ClassifiesAsBruteForceNormalisationDoes) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (size_t s = 0; s < kScenes; ++s) {
    Trajectory trajectory(spec().trajectory().waypoints(), 2);
    for (Eigen::Index i = 0; i < trajectory.size(); ++i) {
      trajectory.data()[i] = expected_[s].reference[static_cast<size_t>(i)] + normal(random);
    }
    const Classification classification = session_->Classify(encodings_[s], trajectory);
    EXPECT_NEAR(classification.responsibilities.sum(), 1.0, 1e-12);
    ExpectNear(Doubles(classification.responsibilities),
               reference_.Responsibilities(expected_[s], Doubles(trajectory)), kTolerance,
               "q(y|x,s)");
  }
}

// A recording may lose its target for a moment and find another far away.
TEST_P(LanesModelTest, ATrajectoryThatJumpsIsClassifiedInFiniteNumbers) {
  for (const double jump : {600.0, -1e5, 1e8}) {
    Trajectory trajectory = Trajectory::Zero(spec().trajectory().waypoints(), 2);
    trajectory(1, 0) = jump;
    const Classification classification = session_->Classify(encodings_[0], trajectory);
    EXPECT_NEAR(classification.responsibilities.sum(), 1.0, 1e-9) << jump;
    EXPECT_TRUE(std::isfinite(classification.log_likelihood_bound)) << jump;
  }
}

// What is relative to the reference does not change when reference and trajectory move together.
TEST_P(LanesModelTest, TheBoundOfATrajectoryIsRelativeToTheReference) {
  const Eigen::Index T = spec().trajectory().waypoints();
  Trajectory trajectory = Trajectory::Random(T, 2);
  SceneEncoding moved = encodings_[2];
  SceneEncoding still = encodings_[2];
  still.reference.resize(0, 2);
  moved.reference = Trajectory::Constant(T, 2, 4.0);
  const Classification in_metres = session_->Classify(still, trajectory);
  trajectory.array() += 4.0;
  const Classification relative = session_->Classify(moved, trajectory);
  EXPECT_NEAR(relative.log_likelihood_bound, in_metres.log_likelihood_bound,
              1e-5 * std::abs(in_metres.log_likelihood_bound));
}

TEST_P(LanesModelTest, AnswersHaveTheSameBitsAloneAndInAnyBatch) {
  const std::vector<int> actions = AllActions();
  std::mt19937 random(9);
  for (int round = 0; round < 10; ++round) {
    std::vector<size_t> order;
    for (size_t i = 0; i < 1 + random() % 20; ++i) order.push_back(random() % kScenes);
    std::vector<SceneInputsView> batch;
    for (const size_t s : order) batch.push_back(inputs_[s]);
    std::vector<SceneEncoding> together(batch.size());
    session_->Encode(batch, together);
    for (size_t i = 0; i < order.size(); ++i) {
      std::vector<SceneEncoding> alone(1);
      session_->Encode({&inputs_[order[i]], 1}, alone);
      ASSERT_TRUE(SameBits(together[i], alone[0])) << order[i];
    }
  }
  const auto all = session_->Describe(encodings_[6], actions, LatentSource::kPosterior);
  for (size_t k = 0; k < actions.size(); ++k) {
    const auto one = session_->Describe(encodings_[6], {&actions[k], 1}, LatentSource::kPosterior);
    EXPECT_TRUE(SameBits(all[k], one[0])) << k;
  }
}

TEST_P(LanesModelTest, TheOrderOfLanePathsAndOfAgentsDoesNotMatter) {
  scene::SceneVectors swapped = vectors_[6];
  const auto paths = swapped.paths.values.begin();
  std::rotate(paths, paths + 2 * scene::kLanePathInputs, swapped.paths.values.end());
  const auto agents = swapped.agents.values.begin();
  std::rotate(agents, agents + 5 * scene::kAgentInputs, swapped.agents.values.end());
  SceneInputsView input = inputs_[6];
  input.vectors = &swapped;
  std::vector<SceneEncoding> encoding(1);
  session_->Encode({&input, 1}, encoding);
  ExpectNear(Doubles(encoding[0].probabilities), Doubles(encodings_[6].probabilities), 1e-5,
             "p(y|s)");
}

// Models without a raster only store weights in bf16, so they run on any processor. Models with a
// raster compute in bf16 and are skipped on processors that cannot.
TEST_P(LanesModelTest, WeightsInBf16ChangeProbabilitiesByLessThanAHundredth) {
  if (spec().has_raster() && !ProcessorHasBf16()) {
    GTEST_SKIP() << "this processor does not compute with bf16";
  }
  const PackedNetworks networks(spec(), stored_.weights, true);
  std::vector<const scene::SceneVectors*> vectors;
  for (const scene::SceneVectors& scene : vectors_) vectors.push_back(&scene);
  if (spec().has_raster()) {
    const auto rough = *ActionModel::FromStored(stored_, {.precision = Precision::kBf16});
    std::vector<SceneEncoding> encodings(inputs_.size());
    rough->NewSession()->Encode(inputs_, encodings);
    for (size_t s = 0; s < kScenes; ++s) {
      const double difference =
          (encodings[s].probabilities - encodings_[s].probabilities).cwiseAbs().maxCoeff();
      EXPECT_LT(difference, 0.01);
      EXPECT_GT(difference, 0.0);
    }
    return;
  }
  SceneVectorFeatures features;
  networks.scene->Evaluate(vectors, nullptr, &features);
  ActionFeatures geometry;
  if (networks.actions) {
    std::vector<const Trajectory*> references;
    for (const SceneEncoding& encoding : encodings_) references.push_back(&encoding.reference);
    networks.actions->Evaluate(vectors, references, features, &geometry);
  }
  const int K = spec().actions();
  Eigen::MatrixXf logits(K, kScenes);
  MlpScratch scratch;
  networks.action_predictor.Apply(features.features.data(), kScenes, &scratch, logits.data());
  if (networks.actions) {
    logits += Eigen::Map<const Eigen::MatrixXf>(geometry.logits.data(), K, kScenes);
  }
  for (Eigen::Index s = 0; s < kScenes; ++s) {
    const Eigen::VectorXd probabilities = probability::Softmax(logits.col(s).cast<double>());
    const Eigen::VectorXd& exact = encodings_[static_cast<size_t>(s)].probabilities;
    EXPECT_LT((probabilities - exact).cwiseAbs().maxCoeff(), 0.01);
    EXPECT_GT((probabilities - exact).cwiseAbs().maxCoeff(), 0.0);
  }
}

TEST_P(LanesModelTest, AModelWithoutARasterReadsNone) {
  EXPECT_EQ(PackedNetworks(spec(), stored_.weights, false).backbone.has_value(),
            spec().has_raster());
}

INSTANTIATE_TEST_SUITE_P(Specs, LanesModelTest, testing::ValuesIn(Cases()),
                         [](const auto& instance) { return std::string(instance.param.name); });

TEST(WeightFaultTest, AVarianceHasNoNegativeFactor) {
  artifact::StoredModel stored = RandomModel(SpecOfPreset("lanes"), 3);
  EXPECT_EQ(artifact::FindWeightFault(stored.manifest.spec(), stored.weights), "");
  stored.weights.at("scene_covariance.speed_factor").values[2] = -1.0f;
  EXPECT_THAT(artifact::FindWeightFault(stored.manifest.spec(), stored.weights),
              testing::HasSubstr("scene_covariance.speed_factor"));
}

}  // namespace
}  // namespace maneuver::inference::lanes_model_test
