#include "model/evaluation/evaluator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "model/artifact/model_spec.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_blocks.h"
#include "model/evaluation/action_coincidence.h"
#include "model/inference/anchor_model.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::evaluation::evaluator_test {
namespace {

using inference::Trajectory;

constexpr int kWaypoints = 6;  // 3 s at 2 Hz
constexpr double kSpeed = 10.0;
constexpr double kAcceleration = 1.0;

// Three actions. Action 0, the most probable, is the truth of a vehicle that accelerates at kSpeed,
// but 1 m to the left; action 1 is that truth; action 2 stays where it is. All generic
// distributions are 4 m to the left of these. q(y|x,s) always selects action 1.
//
// For a relative model, the generic distributions are 4 m to the left only if the encoding knows
// the speed, and 100 m off otherwise.
class FakeSession final : public inference::InferenceSession {
 public:
  FakeSession(bool relative, const Eigen::Vector3d& probabilities)
      : relative_(relative), probabilities_(probabilities) {}

  void Encode(std::span<const inference::SceneInputsView> scenes,
              std::span<inference::SceneEncoding> encodings) override {
    for (size_t i = 0; i < scenes.size(); ++i) {
      encodings[i].probabilities = probabilities_;
      if (relative_) encodings[i].speed = scenes[i].vectors->motion.speed;
    }
  }

  std::vector<inference::ActionDistribution> Describe(const inference::SceneEncoding& encoding,
                                                      std::span<const int> actions,
                                                      inference::LatentSource source) override {
    const bool generic = source == inference::LatentSource::kPrior;
    std::vector<inference::ActionDistribution> distributions;
    for (const int action : actions) {
      Trajectory mean = Trajectory::Zero(kWaypoints, 2);
      for (int i = 0; i < kWaypoints; ++i) {
        const double t = 0.5 * (i + 1);
        const double travelled = kSpeed * t + 0.5 * kAcceleration * t * t;
        mean.row(i) << (action == 2 ? 0.0 : travelled), (action == 0 ? 1.0 : 0.0);
      }
      if (generic) mean.col(1).array() += 4.0;
      if (relative_ && std::abs(encoding.speed - kSpeed) > 1e-4) mean.col(1).array() += 100.0;
      inference::ActionDistribution distribution;
      distribution.action = action;
      // One latent dimension that spreads along x: 2 m for generic, 1 m in the scene.
      Trajectory spread = Trajectory::Zero(kWaypoints, 2);
      spread.col(0).setConstant(generic ? 2.0 : 1.0);
      distribution.sigma = {mean, mean + spread, mean - spread};
      distribution.moment_mean = mean;
      distribution.moment_covariance.resize(kWaypoints, 3);
      distribution.moment_covariance.rowwise() = Eigen::RowVector3d(1.0, 0.0, 1.0);
      distributions.push_back(std::move(distribution));
    }
    return distributions;
  }

  // The evaluation describes every action and needs no separate means.
  inference::TrajectorySet MeanTrajectories(const inference::SceneEncoding&, std::span<const int>,
                                            inference::LatentSource) override {
    return {};
  }

  inference::Classification Classify(const inference::SceneEncoding&, const Trajectory&) override {
    return {.responsibilities = Eigen::Vector3d(0.2, 0.7, 0.1)};
  }

 private:
  const bool relative_;
  const Eigen::Vector3d probabilities_;
};

class FakeModel final : public inference::ActionModel {
 public:
  explicit FakeModel(const Eigen::Vector3d& probabilities = {0.6, 0.3, 0.1})
      : probabilities_(probabilities) {
    v1::ModelSpec& spec = *manifest_.mutable_spec();
    spec.mutable_raster()->set_height(32);
    spec.mutable_raster()->set_width(32);
    spec.mutable_raster()->set_meters_per_pixel(1.0);
    spec.mutable_raster()->set_target_position(0.5);
    spec.mutable_raster()->set_history_frames(2);
    spec.mutable_raster()->mutable_frame_interval()->set_nanos(100'000'000);
    spec.mutable_trajectory()->set_waypoints(kWaypoints);
    spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(500'000'000);
    spec.set_actions(3);
    spec.set_latent_dimensions(1);
  }

  // A model that also reads the target's history and predicts relative to its speed.
  static std::shared_ptr<const FakeModel> Relative() {
    auto model = std::make_shared<FakeModel>();
    model->manifest_.mutable_spec()->mutable_scene_vectors()->set_history_width(1);
    model->manifest_.mutable_spec()->set_reference(v1::TRAJECTORY_REFERENCE_CONSTANT_VELOCITY);
    return model;
  }

  // The relative model; it also reads nearby agents if `agent_width` is not 0.
  static std::shared_ptr<const FakeModel> AmongAgents(int agent_width) {
    auto model = std::make_shared<FakeModel>();
    *model->manifest_.mutable_spec() = Relative()->spec();
    v1::SceneVectorsSpec& vectors = *model->manifest_.mutable_spec()->mutable_scene_vectors();
    vectors.set_agent_width(agent_width);
    vectors.set_agent_heads(1);
    return model;
  }

  // A model with its waypoints this far apart, seconds.
  static std::shared_ptr<const FakeModel> WithInterval(int seconds,
                                                       const Eigen::Vector3d& probabilities) {
    auto model = std::make_shared<FakeModel>(probabilities);
    auto& interval =
        *model->manifest_.mutable_spec()->mutable_trajectory()->mutable_waypoint_interval();
    interval.set_seconds(seconds);
    interval.clear_nanos();
    return model;
  }

  // A model whose manifest has its actions: straight on, 20 m, 10 m and not at all.
  static std::shared_ptr<const FakeModel> WithActions() {
    auto model = std::make_shared<FakeModel>();
    for (int i = 0; i < 3; ++i) {
      v1::Action& action = *model->manifest_.add_actions();
      action.set_action_id(i);
      action.set_effective(true);
      v1::Trajectory& mean = *action.mutable_distribution()->mutable_mean_trajectory();
      for (int waypoint = 1; waypoint <= kWaypoints; ++waypoint) {
        mean.add_x((20.0 - 10.0 * i) * waypoint / kWaypoints);
        mean.add_y(0.0);
      }
    }
    return model;
  }

  const v1::ModelManifest& manifest() const override { return manifest_; }
  std::string_view precision() const override { return "f32"; }
  size_t weight_bytes() const override { return 4; }
  std::unique_ptr<inference::InferenceSession> NewSession() const override {
    return std::make_unique<FakeSession>(artifact::HasReference(spec()), probabilities_);
  }

 private:
  const Eigen::Vector3d probabilities_;
  v1::ModelManifest manifest_;
};

// A vehicle that heads north-west at kSpeed at time 1 and is present for four seconds; `others`
// that stand beside it then and are not vehicles; and one of these that appears later.
v1::Scenario Recording(const std::string& id, int others) {
  const double heading = 2.3;
  v1::Scenario scenario;
  scenario.set_scenario_id(id);
  v1::Agent& vehicle = *scenario.add_agents();
  vehicle.set_id(7);
  vehicle.set_type(v1::AGENT_TYPE_VEHICLE);
  vehicle.set_length(4.0);
  vehicle.set_width(2.0);
  for (int i = 0; i <= 40; ++i) {
    const double t = 0.1 * i - 1.0;
    const double travelled = kSpeed * t + 0.5 * kAcceleration * t * t;
    const double speed = kSpeed + kAcceleration * t;
    v1::AgentState& state = *vehicle.add_states();
    state.set_time(t + 1.0);
    state.set_x(100.0 + travelled * std::cos(heading));
    state.set_y(-50.0 + travelled * std::sin(heading));
    state.set_heading(static_cast<float>(heading));
    state.set_velocity_x(static_cast<float>(speed * std::cos(heading)));
    state.set_velocity_y(static_cast<float>(speed * std::sin(heading)));
  }
  for (int i = 0; i < others; ++i) {
    v1::Agent& agent = *scenario.add_agents();
    agent.set_id(100 + i);
    agent.set_type(v1::AGENT_TYPE_OTHER);
    agent.set_length(1.0);
    agent.set_width(1.0);
    agent.add_states()->set_time(1.0);
  }
  v1::Agent& late = *scenario.add_agents();
  late.set_id(8);
  late.set_type(v1::AGENT_TYPE_OTHER);
  late.set_length(1.0);
  late.set_width(1.0);
  late.add_states()->set_time(3.5);
  return scenario;
}

class EvaluatorTest : public testing::Test {
 protected:
  EvaluatorTest() {
    input_.examples.mutable_stride()->set_seconds(1);
    input_.examples.set_keep_standing(1.0);
    for (int i = 0; i < 20; ++i) recordings_.push_back(Recording(std::to_string(i), i));
    input_.recordings = recordings_;
  }

  std::vector<v1::Scenario> recordings_;
  EvaluationInput input_;
  std::shared_ptr<const FakeModel> model_ = std::make_shared<FakeModel>();
};

// With this error the job fails as METRICS_NOT_FINITE.
TEST_F(EvaluatorTest, RefusesTheFiguresOfAModelThatOverflows) {
  const FakeModel model({std::numeric_limits<double>::infinity(), 0.3, 0.1});
  const auto report = Evaluate(model, input_);
  EXPECT_TRUE(absl::IsOutOfRange(report.status())) << report.status();
  EXPECT_THAT(std::string(report.status().message()),
              testing::MatchesRegex("the evaluation's metrics\\[.*\\] is not finite"));
}

TEST_F(EvaluatorTest, MeasuresModelAndBaselinesAgainstTheRecording) {
  const auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  // Only 1 s has both a past and a whole horizon.
  EXPECT_EQ(report->examples(), 20);
  EXPECT_EQ(report->example_settings().SerializeAsString(), input_.examples.SerializeAsString());
  EXPECT_EQ(report->trajectory().SerializeAsString(),
            model_->spec().trajectory().SerializeAsString());
  const auto& metrics = report->metrics();
  EXPECT_NEAR(metrics.at("ade_1"), 1.0, 1e-4);
  EXPECT_NEAR(metrics.at("min_ade_6"), 0.0, 1e-4);
  EXPECT_NEAR(metrics.at("ade_1_prior"), 5.0, 1e-4);
  EXPECT_NEAR(metrics.at("min_ade_6_prior"), 4.0, 1e-4);
  EXPECT_NEAR(metrics.at("brier_fde_6"), 0.7 * 0.7, 1e-4);
  // Half of t^2 at 0.5, 1, ... 3 s.
  EXPECT_NEAR(metrics.at("ade_cv"), 0.5 * 91.0 / 24.0, 1e-4);
  EXPECT_NEAR(metrics.at("fde_cv"), 4.5, 1e-4);
  EXPECT_NEAR(metrics.at("ade_ctra"), 0.0, 1e-4);
  // The acceleration fades with e^-t, so speed grows by 1 - e^-t and distance by t - (1 - e^-t).
  double lag = 0.0;
  for (int i = 1; i <= kWaypoints; ++i) {
    const double t = 0.5 * i;
    lag += (0.5 * t * t - t + 1.0 - std::exp(-t)) / kWaypoints;
  }
  EXPECT_NEAR(metrics.at("ade_faded"), lag, 2e-3);
  EXPECT_NEAR(metrics.at("nmi_kinematic"), 0.0, 1e-12);
  EXPECT_NEAR(metrics.at("largest_share"), 0.6, 1e-12);
  EXPECT_EQ(report->action_uses(1).kinematic_class(), "straight_fast");
  EXPECT_EQ(report->action_uses(1).examples(), 20);
  // It predicts 0.6 for action 0, to which q gives 0.2.
  EXPECT_NEAR(metrics.at("calibration_error"), 0.4, 1e-12);
}

TEST_F(EvaluatorTest, MeasuresTheGenericActionsOfARelativeModelInEachScene) {
  const auto metres = Evaluate(*model_, input_);
  const auto relative = Evaluate(*FakeModel::Relative(), input_);
  ASSERT_TRUE(metres.ok() && relative.ok()) << relative.status();
  for (const auto& [name, value] : metres->metrics()) {
    EXPECT_EQ(value, relative->metrics().at(name)) << name;
  }
}

// The most probable action stands still, 19.4 m behind on average. Action 1, the truth, is closest
// to all three together.
TEST_F(EvaluatorTest, MeasuresTheMedoidAndTheRepresentatives) {
  const FakeModel model({0.3, 0.3, 0.4});
  const auto report = Evaluate(model, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  const auto& metrics = report->metrics();
  EXPECT_NEAR(metrics.at("ade_1"), kSpeed * 1.75 + 0.5 * 91.0 / 24.0, 1e-4);
  EXPECT_NEAR(metrics.at("ade_medoid"), 0.0, 1e-4);
  EXPECT_NEAR(metrics.at("fde_medoid"), 0.0, 1e-4);
  EXPECT_EQ(metrics.at("miss_rate_1"), 1.0);
  EXPECT_EQ(metrics.at("miss_rate_medoid"), 0.0);
  EXPECT_NEAR(metrics.at("min_ade_cover_6"), 0.0, 1e-4);
  EXPECT_EQ(metrics.at("miss_rate_cover_6"), 0.0);
}

// 4.5 m along the heading exceeds 2.0 m x 0.948 at 3 s; 1 m to the side exceeds 0.948 m.
TEST_F(EvaluatorTest, WaymoMissesAreMeasuredAlongTheRecordedHeading) {
  const auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_NEAR(report->metrics().at("miss_rate_waymo_1"), 1.0, 1e-12);
  EXPECT_NEAR(report->metrics().at("miss_rate_waymo_5"), 0.0, 1e-12);
  EXPECT_NEAR(report->metrics().at("miss_rate_waymo_cv"), 1.0, 1e-12);
  EXPECT_NEAR(report->metrics().at("miss_rate_waymo_ctra"), 0.0, 1e-12);
}

// At 3 s there is no state near, because the track has a gap between the waypoints at 2 s and 4 s.
// The vehicle moves 1.6 m to its left meanwhile, and the most probable action stays. So the error is
// 0.8 m at 3 s. That is a hit along the heading, within 2.0 m x 0.5, and a miss across, beyond
// 1.0 m x 0.5.
TEST_F(EvaluatorTest, WaymoMissesInAGapAreMeasuredAlongTheCourse) {
  v1::Scenario recording;
  recording.set_scenario_id("gap");
  v1::Agent& vehicle = *recording.add_agents();
  vehicle.set_id(7);
  vehicle.set_type(v1::AGENT_TYPE_VEHICLE);
  vehicle.set_length(4.0);
  vehicle.set_width(2.0);
  for (int i = 0; i <= 130; ++i) {
    if (i > 31 && i < 49) continue;
    const bool moved = i > 31;
    v1::AgentState& state = *vehicle.add_states();
    state.set_time(0.1 * i);
    state.set_y(moved ? 1.6 : 0.0);
    state.set_heading(moved ? static_cast<float>(std::numbers::pi / 2.0) : 0.0F);
  }
  input_.recordings = {&recording, 1};
  const auto report = Evaluate(*FakeModel::WithInterval(2, {0.2, 0.2, 0.6}), input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->examples(), 1);
  EXPECT_NEAR(report->metrics().at("ade_1"), 1.6 * 5.0 / 6.0, 1e-4);
  EXPECT_EQ(report->metrics().at("miss_rate_waymo_1"), 0.0);
}

// The example's action is 1 by q(y|x,s), although p(y|s) prefers 0.
TEST_F(EvaluatorTest, EnvelopesBelongToTheExamplesAction) {
  const auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  const auto& metrics = report->metrics();
  EXPECT_DOUBLE_EQ(metrics.at("coverage_1sigma"), 1.0);        // exactly at the mean
  EXPECT_DOUBLE_EQ(metrics.at("coverage_2sigma_prior"), 0.0);  // 4 m off at 1 m
  EXPECT_DOUBLE_EQ(metrics.at("mean_sigma_posterior"), std::sqrt(0.5));
  EXPECT_DOUBLE_EQ(metrics.at("mean_sigma_ratio"), 0.5);
  EXPECT_NEAR(metrics.at("nll_action_prior") - metrics.at("nll_action"), 8.0, 1e-3);
}

TEST_F(EvaluatorTest, StrataCountAgentsAtThePredictionTime) {
  const auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  // 0 to 19 others, plus the vehicle itself.
  EXPECT_EQ(report->strata(0).examples(), 10);
  EXPECT_EQ(report->strata(1).examples(), 10);
}

TEST_F(EvaluatorTest, RangesOfInputsAreThoseOfTheExamples) {
  for (size_t i = 0; i < recordings_.size(); ++i) {
    // Features beside the vehicle, and one that is far from it.
    for (size_t j = 0; j <= i + 5; ++j) {
      v1::MapFeature& feature = *recordings_[i].add_map_features();
      for (const double x : {90.0, 110.0}) {
        feature.add_x(j == 0 ? x + 900.0 : x);
        feature.add_y(-50.0);
      }
    }
  }
  const auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  const auto& ranges = report->input_ranges();
  ASSERT_EQ(ranges.size(), 3u);
  EXPECT_NEAR(ranges.at("speed").low(), kSpeed, 1e-3);
  EXPECT_NEAR(ranges.at("speed").high(), kSpeed, 1e-3);
  EXPECT_EQ(ranges.at("agents").low(), 1.0);
  EXPECT_EQ(ranges.at("agents").high(), 20.0);
  EXPECT_EQ(ranges.at("map").low(), 5.0);
  EXPECT_EQ(ranges.at("map").high(), 24.0);
}

// The same vehicle drives the same way in all recordings.
TEST_F(EvaluatorTest, RecordingsOfOneDriveFormOneGroup) {
  auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->rivals().recordings(), 20);
  EXPECT_EQ(report->rivals().groups(), 1);
  EXPECT_EQ(report->rivals().largest_group(), 20);
  EXPECT_EQ(report->rivals().parts(0).examples(), 20);

  for (size_t i = 0; i < recordings_.size(); ++i) {
    recordings_[i].mutable_agents(0)->set_id(1000 + static_cast<int64_t>(i) / 2);
  }
  report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->rivals().groups(), 10);
  EXPECT_EQ(report->rivals().parts(0).groups(), 10);
}

TEST_F(EvaluatorTest, MeasuresAgreementWithRecordedManoeuvresIfThereAreAny) {
  auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_FALSE(report->metrics().contains("nmi"));
  std::vector<v1::ManeuverAnnotation> annotations(1);
  annotations[0].set_scenario_id("3");
  annotations[0].set_agent_id(7);
  annotations[0].set_start_time(3.9);
  annotations[0].set_end_time(9.0);
  annotations[0].set_maneuver("keep_lane");
  input_.annotations = annotations;
  report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->metrics().at("labelled_examples"), 1.0);
}

TEST_F(EvaluatorTest, SamplesTheSameExamplesInAnyOrderOfRecordings) {
  auto report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->sampled_examples_size(), 0);
  input_.sampled_examples = 6;
  report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  ASSERT_EQ(report->sampled_examples_size(), 6);
  const v1::EvaluatedExample& first = report->sampled_examples(0);
  EXPECT_EQ(first.target_id(), 7);
  EXPECT_EQ(first.time(), 1.0);
  ASSERT_EQ(first.trajectory().x_size(), kWaypoints);
  EXPECT_NEAR(first.trajectory().x(kWaypoints - 1), 3.0 * kSpeed + 4.5 * kAcceleration, 1e-4);
  EXPECT_NEAR(first.trajectory().y(kWaypoints - 1), 0.0, 1e-4);
  EXPECT_THAT(first.probabilities(), testing::ElementsAre(0.6, 0.3, 0.1));
  EXPECT_THAT(first.responsibilities(), testing::ElementsAre(0.2, 0.7, 0.1));

  const auto drawn = [](const v1::EvaluationReport& from) {
    std::vector<int> ids;
    for (const auto& example : from.sampled_examples())
      ids.push_back(std::stoi(example.scenario_id()));
    return ids;
  };
  const std::vector<int> ids = drawn(*report);
  EXPECT_TRUE(std::is_sorted(ids.begin(), ids.end()));   // in the order of the recordings
  EXPECT_NE(ids, (std::vector<int>{0, 1, 2, 3, 4, 5}));  // and not the first of them
  std::reverse(recordings_.begin(), recordings_.end());
  report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_THAT(drawn(*report), testing::UnorderedElementsAreArray(ids));
  input_.sampled_examples = 1000;
  report = Evaluate(*model_, input_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->sampled_examples_size(), 20);
}

TEST_F(EvaluatorTest, GivesTheSameBitsOnAnyNumberOfThreads) {
  const auto one = Evaluate(*model_, input_);
  input_.threads = 3;
  const auto three = Evaluate(*model_, input_);
  ASSERT_TRUE(one.ok() && three.ok());
  for (const auto& [name, value] : one->metrics()) {
    EXPECT_EQ(value, three->metrics().at(name)) << name;
  }
}

// Writes the recordings to a dataset folder and opens it in blocks of one recording: there is no
// memory for two.
absl::StatusOr<data::RecordingBlocks> OneByOne(const std::vector<v1::Scenario>& recordings,
                                               const std::filesystem::path& folder) {
  auto writer = data::DatasetWriter::Create(folder, "a test");
  if (!writer.ok()) return writer.status();
  for (const v1::Scenario& recording : recordings) {
    const absl::Status added = (*writer)->Add(recording);
    if (!added.ok()) return added;
  }
  const absl::Status committed = (*writer)->Commit().status();
  if (!committed.ok()) return committed;
  return data::RecordingBlocks::Open(folder, 1, [] { return true; });
}

TEST_F(EvaluatorTest, MeasuresBlocksToTheSameDigitsAsRecordingsInMemory) {
  const TemporaryFolder temporary;
  const auto blocks = OneByOne(recordings_, temporary.path() / "dataset");
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  input_.sampled_examples = 6;
  const auto in_memory = Evaluate(*model_, input_);
  ASSERT_TRUE(in_memory.ok()) << in_memory.status();
  input_.recordings = {};
  input_.blocks = &*blocks;
  const auto by_block = Evaluate(*model_, input_);
  ASSERT_TRUE(by_block.ok()) << by_block.status();
  EXPECT_EQ(by_block->DebugString(), in_memory->DebugString());
  EXPECT_EQ(by_block->sampled_examples_size(), 6);
}

TEST_F(EvaluatorTest, MatchesActionsOverBlocksToTheSameDigits) {
  const TemporaryFolder temporary;
  const auto blocks = OneByOne(recordings_, temporary.path() / "dataset");
  ASSERT_TRUE(blocks.ok()) << blocks.status();
  const auto model = FakeModel::WithActions();
  const auto in_memory = MeasureMatching(*model, *model, input_);
  ASSERT_TRUE(in_memory.ok()) << in_memory.status();
  EXPECT_GT(in_memory->coincidence().examples(), 0);
  input_.recordings = {};
  input_.blocks = &*blocks;
  const auto by_block = MeasureMatching(*model, *model, input_);
  ASSERT_TRUE(by_block.ok()) << by_block.status();
  EXPECT_EQ(by_block->DebugString(), in_memory->DebugString());
}

// Returns a baseline that reads the same as a model of `spec`, with smaller, random networks.
std::shared_ptr<const inference::AnchorModel> BaselineOf(v1::ModelSpec spec) {
  spec.mutable_backbone()->set_features(2);
  spec.mutable_backbone()->add_convolutions()->set_channels(1);
  spec.mutable_backbone()->mutable_convolutions(0)->set_stride(2);
  spec.mutable_scene_vectors()->set_features(2);
  if (artifact::ReadsAgents(spec)) spec.mutable_scene_vectors()->set_agent_width(2);
  for (v1::MlpSpec* mlp : {spec.mutable_action_predictor(), spec.mutable_trajectory_encoder(),
                           spec.mutable_decoder(), spec.mutable_scenario_encoder()}) {
    mlp->add_hidden(1);
  }
  spec.set_decoder_stddev(1.0);
  artifact::TensorMap weights = inference::RandomModel(spec, 1).weights;
  weights["anchors.mean"] = {{3, kWaypoints, 2}, std::vector<float>(6 * kWaypoints, 0.0F)};
  weights["anchors.covariance"].shape = {3, kWaypoints, 3};
  for (int i = 0; i < 3 * kWaypoints; ++i) {
    std::vector<float>& values = weights["anchors.covariance"].values;
    values.insert(values.end(), {1.0F, 0.0F, 1.0F});
  }
  auto baseline = inference::AnchorModel::Make(spec, std::move(weights), {});
  EXPECT_TRUE(baseline.ok()) << baseline.status();
  return *baseline;
}

TEST_F(EvaluatorTest, MeasuresBaselinesThatReadAgentsIfTheModelDoes) {
  for (const int of_model : {0, 3}) {
    for (const int of_baselines : {0, 3}) {
      const auto baseline = BaselineOf(FakeModel::AmongAgents(of_baselines)->spec());
      const inference::AnchorBaselines baselines{baseline, baseline};
      input_.baselines = &baselines;
      const auto report = Evaluate(*FakeModel::AmongAgents(of_model), input_);
      EXPECT_EQ(report.status().code(), of_model == of_baselines
                                            ? absl::StatusCode::kOk
                                            : absl::StatusCode::kFailedPrecondition)
          << of_model << " " << of_baselines << " " << report.status();
      if (!report.ok()) continue;
      EXPECT_TRUE(report->metrics().contains("covernet_ade_1"));
    }
  }
}

TEST_F(EvaluatorTest, RefusesRecordingsWithoutAnExampleAndStopsWhenAsked) {
  input_.progress = [](int64_t, int64_t) { return false; };
  while (recordings_.size() < 100) recordings_.push_back(recordings_.front());
  input_.recordings = recordings_;
  EXPECT_EQ(Evaluate(*model_, input_).status().code(), absl::StatusCode::kCancelled);
  input_.recordings = {};
  EXPECT_EQ(Evaluate(*model_, input_).status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace maneuver::evaluation::evaluator_test
