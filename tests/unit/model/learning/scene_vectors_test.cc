// What training reads of a scene as vectors, and what the networks make of it.

#include <ATen/ops/equal.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "model/data/stable_hash.h"
#include "model/files/durable_file.h"
#include "model/learning/objectives.h"
#include "model/learning/optimizer.h"
#include "model/learning/scene_bound.h"
#include "model/learning/scene_loader.h"
#include "model/learning/trainer.h"
#include "model/learning/validation.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::scene_vectors_test {
namespace {

// One recording whose examples a Lanes model reads.
ExampleSet Recorded(v1::Scenario recording, const v1::TrainingSettings& settings) {
  ExampleSet set;
  set.recordings.push_back(std::move(recording));
  set.examples =
      data::EnumerateExamples(set.recordings[0], 0, settings.model(), settings.examples());
  return set;
}

// Adds a cyclist who comes towards the vehicle and rides across its way, from the left (side 1) or
// from the right (side -1).
v1::Scenario WithCyclist(v1::Scenario recording, double side) {
  v1::Agent& cyclist = *recording.add_agents();
  cyclist.set_id(2);
  cyclist.set_type(v1::AGENT_TYPE_CYCLIST);
  cyclist.set_length(1.8);
  cyclist.set_width(0.7);
  for (int i = 0; i <= 80; ++i) {
    const double time = 0.1 * i;
    v1::AgentState& state = *cyclist.add_states();
    state.set_time(time);
    state.set_x(30.0 - 2.0 * time);
    state.set_y(side * (6.0 - time));
    state.set_heading(static_cast<float>(side * (0.1 * time - 2.7)));
    state.set_velocity_x(-2.0F);
    state.set_velocity_y(static_cast<float>(-side));
  }
  return recording;
}

SceneLoader::Batch First(const ExampleSet& set, const Variation& variation,
                         const v1::TrainingSettings& settings) {
  const SceneSource source(settings.model(), set, 1);
  return *SceneLoader(settings.model(), source, {{0, variation}}, 1, 1).Next();
}

void ExpectNear(const at::Tensor& a, const at::Tensor& b, double tolerance, const char* what) {
  EXPECT_LE((a - b).abs().max().item<double>(), tolerance) << what;
}

void ExpectSame(const SceneLoader::Batch& a, const SceneLoader::Batch& b) {
  ExpectNear(a.scenes.histories, b.scenes.histories, 1e-4, "history");
  ExpectNear(a.scenes.lane_paths, b.scenes.lane_paths, 2e-3, "lane paths");
  ExpectNear(a.scenes.path_mask, b.scenes.path_mask, 0.0, "mask");
  ExpectNear(a.scenes.agents, b.scenes.agents, 1e-4, "agents");
  ExpectNear(a.scenes.agent_mask, b.scenes.agent_mask, 0.0, "mask of agents");
  EXPECT_EQ(a.scenes.agent_mask.sum().item<double>(), 1.0);
  ExpectNear(a.scenes.references, b.scenes.references, 2e-3, "reference");
  ExpectNear(a.trajectories, b.trajectories, 2e-3, "trajectory");
}

TEST(SceneVectorsTest, AMirroredExampleMatchesTheMirroredWorld) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  const ExampleSet left = Recorded(WithCyclist(ArcRecording("arc", 0.04, 9.0), 1.0), settings);
  const ExampleSet right = Recorded(WithCyclist(ArcRecording("arc", -0.04, 9.0), -1.0), settings);
  Variation mirror;
  mirror.mirror = true;
  ExpectSame(First(left, mirror, settings), First(right, {}, settings));
}

TEST(SceneVectorsTest, AScaledExampleMatchesTheScaledWorld) {
  constexpr double kScale = 1.1;
  const v1::TrainingSettings settings = TinyLanesSettings();
  v1::Scenario recording = WithCyclist(ArcRecording("arc", 0.03, 8.0), 1.0);
  const ExampleSet plain = Recorded(recording, settings);
  for (v1::Agent& agent : *recording.mutable_agents()) {
    for (v1::AgentState& state : *agent.mutable_states()) {
      state.set_x(kScale * state.x());
      state.set_y(kScale * state.y());
      state.set_velocity_x(static_cast<float>(kScale * state.velocity_x()));
      state.set_velocity_y(static_cast<float>(kScale * state.velocity_y()));
    }
    agent.set_length(kScale * agent.length());
    agent.set_width(kScale * agent.width());
  }
  for (v1::MapFeature& feature : *recording.mutable_map_features()) {
    for (int i = 0; i < feature.x_size(); ++i) {
      feature.set_x(i, kScale * feature.x(i));
      feature.set_y(i, kScale * feature.y(i));
    }
  }
  const ExampleSet large = Recorded(recording, settings);
  Variation scale;
  scale.scale = kScale;
  ExpectSame(First(plain, scale, settings), First(large, {}, settings));
}

TEST(SceneVectorsTest, NoiseTurnsTheFutureWithTheFrame) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  const ExampleSet set = Recorded(WithCyclist(ArcRecording("arc", 0.0, 10.0), 1.0), settings);
  Variation noisy;
  noisy.noise = {.speed_stddev = 0.0, .heading_stddev = 0.02, .seed = 4};
  const SceneLoader::Batch plain = First(set, {}, settings);
  const SceneLoader::Batch turned = First(set, noisy, settings);
  const at::Tensor x = (plain.trajectories + plain.scenes.references).view({-1, 2});
  const at::Tensor y = (turned.trajectories + turned.scenes.references).view({-1, 2});
  ExpectNear(x.norm(2, 1), y.norm(2, 1), 1e-3, "distances");
  EXPECT_GT((x - y).abs().max().item<double>(), 0.05);
  // The agents turn with it.
  const auto bearing = [](const at::Tensor& point) {
    return std::atan2(point[1].item<double>(), point[0].item<double>());
  };
  EXPECT_NEAR(bearing(turned.scenes.agents[0][0]) - bearing(plain.scenes.agents[0][0]),
              bearing(y[9]) - bearing(x[9]), 1e-3);
  // The lane turns with it: straight ahead is still along the lane.
  const at::Tensor lane = turned.scenes.lane_paths[0][0].slice(0, 0, 26).view({13, 2});
  EXPECT_NEAR(bearing(lane[5]), bearing(y[9]), 1e-3);
}

TEST(SceneVectorsTest, AgentsLeftOutAreMasked) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  const ExampleSet set = Recorded(WithCyclist(ArcRecording("arc", 0.0, 10.0), 1.0), settings);
  int left_out = 0;
  for (uint64_t seed = 1; seed <= 200; ++seed) {
    Variation variation;
    variation.drop_agents = 0.25;
    variation.drop_seed = data::SplitMix64(seed);
    const SceneLoader::Batch batch = First(set, variation, settings);
    EXPECT_GT(batch.scenes.path_mask.sum().item<double>(), 0.0);
    if (batch.scenes.agent_mask.sum().item<double>() == 0.0) ++left_out;
  }
  EXPECT_NEAR(left_out, 50, 20);
}

TEST(SceneVectorsTest, RelativeTrajectoriesArePositionsMinusTheReference) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  const ExampleSet set = Recorded(ArcRecording("arc", 0.02, 12.0), settings);
  const SceneLoader::Batch batch = First(set, {}, settings);
  const at::Tensor all = Trajectories(set.examples);
  ExpectNear(all[0], batch.trajectories[0], 1e-4, "relative");
  const at::Tensor positions = at::tensor(at::ArrayRef<float>(set.examples[0].trajectory));
  ExpectNear(all[0] + batch.scenes.references[0], positions, 1e-4, "positions");
  EXPECT_GT(batch.scenes.references.abs().max().item<double>(), 10.0);
}

// The recording has no speed limit and no signal, so nothing is learned about them.
TEST(SceneVectorsTest, WhatNoRecordingHasIsNeitherLearnedNorHasAnEffect) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  at::Generator generator = MakeGenerator(2);
  Networks networks(settings.model(), at::Device(at::kCPU), generator);
  const ExampleSet set = Recorded(ArcRecording("arc", 0.02, 12.0), settings);
  SceneLoader::Batch batch = First(set, {}, settings);
  const SceneFeatures before = networks.EncodeScenes(batch.scenes, {});
  (before.features.square().sum() + before.geometry.square().sum()).backward();
  const at::Tensor gradient = networks["lane_path.0.weight"].grad();
  EXPECT_GT(gradient.select(1, 62).abs().max().item<double>() +
                gradient.select(1, 65).abs().max().item<double>(),
            0.0);
  for (const int64_t number : {68, 74, 75, 76, 77, 79, 80}) {
    EXPECT_EQ(gradient.select(1, number).abs().max().item<double>(), 0.0) << number;
    batch.scenes.lane_paths.select(2, number).fill_(1.0);
  }
  const SceneFeatures after = networks.EncodeScenes(batch.scenes, {});
  EXPECT_TRUE(before.features.equal(after.features));
  EXPECT_TRUE(before.geometry.equal(after.geometry));
}

TEST(SceneVectorsTest, AbsentPathsAndAgentsChangeNothing) {
  const v1::TrainingSettings settings = TinyLanesSettings();
  at::Generator generator = MakeGenerator(2);
  Networks networks(settings.model(), at::Device(at::kCPU), generator);
  const ExampleSet set = Recorded(WithCyclist(ArcRecording("arc", 0.02, 12.0), 1.0), settings);
  SceneLoader::Batch batch = First(set, {}, settings);
  at::NoGradGuard no_grad;
  const SceneFeatures before = networks.EncodeScenes(batch.scenes, {});
  const int64_t count = batch.scenes.path_mask.sum().item<int64_t>();
  ASSERT_GT(count, 0);
  ASSERT_LT(count, 6);
  ASSERT_EQ(batch.scenes.agent_mask.sum().item<int64_t>(), 1);
  batch.scenes.lane_paths.select(1, count).fill_(3.0);
  batch.scenes.agents.select(1, 1).fill_(3.0);
  const SceneFeatures after = networks.EncodeScenes(batch.scenes, {});
  EXPECT_TRUE(before.features.equal(after.features));
  EXPECT_TRUE(before.geometry.equal(after.geometry));
  batch.scenes.agents.select(1, 0).mul_(-1.0);
  EXPECT_FALSE(before.features.equal(networks.EncodeScenes(batch.scenes, {}).features));
}

// Also where they have a row for each action.
TEST(WeightDecayTest, LeavesBiasesAndTheMixture) {
  at::Generator generator = MakeGenerator(2);
  Networks networks(TinyLanesSettings().model(), at::Device(at::kCPU), generator);
  using Part = Networks::Part;
  AdamW optimizer;
  for (const Part part : {Part::kTrajectoryEncoder, Part::kDecoder, Part::kMixture, Part::kScene,
                          Part::kActions, Part::kScenarioEncoder, Part::kSceneCovariance}) {
    optimizer.Add(networks.Parameters(part), networks.Decays(part), 1.0, 0.5);
  }
  for (at::Tensor parameter : optimizer.Parameters()) {
    parameter.detach().fill_(1.0);
    parameter.mutable_grad() = at::zeros_like(parameter.detach());
  }
  optimizer.Step(1.0);
  const auto value = [&](const std::string& name) {
    return networks[name].detach().flatten()[0].item<double>();
  };
  for (const char* name : {"mixture.mean", "mixture.log_variance", "mixture.log_weight",
                           "join.bias", "scenario_encoder.0.bias", "scene_covariance.1.bias",
                           "action_geometry.action.bias", "action_geometry.joint_action.bias"}) {
    EXPECT_EQ(value(name), 1.0) << name;
  }
  for (const char* name : {"join.weight", "scenario_encoder.0.weight", "mean_residual.scene.weight",
                           "decoder.0.weight", "action_geometry.pair.weight"}) {
    EXPECT_EQ(value(name), 0.5) << name;
  }
}

TEST(RobustReconstructionTest, IsQuadraticNearbyAndLinearFarAway) {
  const at::Tensor x = at::zeros({1, 2});
  const auto loss = [&](double distance) {
    const at::Tensor decoded = at::tensor({0.6 * distance, 0.8 * distance}).view({1, 2});
    return -RobustReconstruction(x.to(at::kDouble), decoded, 1.0, 1.5).item<double>();
  };
  EXPECT_NEAR(loss(1e-3), 0.5e-6, 1e-10);
  EXPECT_NEAR(loss(1000.0) - loss(999.0), 1.5, 1e-3);
  EXPECT_NEAR(loss(2.0), 1.5 * 1.5 * (std::sqrt(1.0 + 4.0 / 2.25) - 1.0), 1e-9);
}

TEST(RobustReconstructionTest, ItsGradientIsThatOfFiniteDifferences) {
  at::Generator generator = MakeGenerator(5);
  const at::Tensor x = at::empty({3, 8}, at::kDouble).normal_(0.0, 2.0, generator);
  at::Tensor decoded = at::empty({3, 8}, at::kDouble).normal_(0.0, 2.0, generator);
  decoded.set_requires_grad(true);
  RobustReconstruction(x, decoded, 0.7, 1.0).sum().backward();
  at::NoGradGuard no_grad;
  for (const int64_t i : {0, 5, 11, 23}) {
    at::Tensor one = decoded.flatten()[i];
    constexpr double kStep = 1e-5;
    one.add_(kStep);
    const double above = RobustReconstruction(x, decoded, 0.7, 1.0).sum().item<double>();
    one.sub_(2.0 * kStep);
    const double below = RobustReconstruction(x, decoded, 0.7, 1.0).sum().item<double>();
    one.add_(kStep);
    EXPECT_NEAR(decoded.grad().flatten()[i].item<double>(), (above - below) / (2.0 * kStep), 1e-6);
  }
}

// Eight examples of vehicles that drive arcs.
SceneLoader::Batch ArcBatch(const v1::TrainingSettings& settings) {
  const TrainingData data = *SplitRecordings(ArcRecordings(40), settings);
  const SceneSource source(settings.model(), data.training, 1);
  SceneLoader loader(settings.model(), source, DrawItems(data.training, 8), 8, 1);
  return *loader.Next();
}

// With as many actions as there are, the reconstruction over the likeliest ones is that over all.
TEST(SceneBoundTest, TheKMostProbableOfKActionsAreAll) {
  v1::TrainingSettings settings = TinyLanesSettings();
  settings.mutable_optimization()->set_responsibilities(v1::RESPONSIBILITIES_PRINTED);
  at::Generator generator = MakeGenerator(2);
  Networks networks(settings.model(), at::Device(at::kCPU), generator);
  const SceneLoader::Batch batch = ArcBatch(settings);
  const NoiseSource means = [](at::IntArrayRef shape) { return at::zeros(shape); };
  at::NoGradGuard no_grad;
  const SceneBatch scenes{batch.trajectories, networks.EncodeScenes(batch.scenes, {}), {}};
  const auto reconstruction = [&](int actions) {
    settings.mutable_optimization()->set_posterior_actions(actions);
    return SceneBound(networks, v1::OBJECTIVE_UNIFIED, Learning::kAll, settings.optimization(),
                      scenes, means)
        .posterior_reconstruction;
  };
  const at::Tensor all = reconstruction(0);
  ExpectNear(reconstruction(6), all, 1e-4, "all of six");
  const at::Tensor five = reconstruction(5);
  ExpectNear(five, all, 0.5 * all.abs().max().item<double>(), "five of six");
  EXPECT_FALSE(five.equal(all));
  settings.mutable_optimization()->set_responsibilities(v1::RESPONSIBILITIES_EXACT);
  EXPECT_TRUE(reconstruction(5).equal(reconstruction(0))) << "they contain each reconstruction";
}

// The responsibilities get no gradient. With all weights of the loss 1 but the reconstruction's, exact
// ones maximise the bound, so the slope of the loss with responsibilities that follow it is the
// same: a second way to all gradients of the networks that read scenes.
TEST(SceneBoundTest, TheGradientOfTheWholeLossIsThatOfFiniteDifferences) {
  v1::TrainingSettings settings = TinyLanesSettings();
  v1::OptimizationSettings& optimization = *settings.mutable_optimization();
  ASSERT_EQ(optimization.responsibilities(), v1::RESPONSIBILITIES_EXACT);
  ASSERT_TRUE(settings.model().mean_residual());
  optimization.set_action_weight(1.0);
  optimization.set_posterior_divergence_weight(1.0);
  // With these weights the loss bends little: no ReLU changes its side close by, and no difference is
  // beyond two thirds of its tolerance. With other seeds of the weights one does.
  at::Generator generator = MakeGenerator(11);
  Networks networks(settings.model(), at::Device(at::kCPU), generator);
  const SceneLoader::Batch batch = ArcBatch(settings);
  const auto loss = [&] {
    at::Generator noise = MakeGenerator(9);
    const NoiseSource draw = [&](at::IntArrayRef shape) {
      return at::empty(shape).normal_(0.0, 1.0, noise);
    };
    const SceneBatch scenes{batch.trajectories, networks.EncodeScenes(batch.scenes, {}), {}};
    return Loss(
        SceneBound(networks, v1::OBJECTIVE_UNIFIED, Learning::kAll, optimization, scenes, draw),
        Weights(optimization));
  };
  using Part = Networks::Part;
  std::vector<at::Tensor> parameters;
  for (const Part part :
       {Part::kTrajectoryEncoder, Part::kScene, Part::kActions, Part::kScenarioEncoder}) {
    for (at::Tensor& parameter : networks.Parameters(part)) {
      // Fresh last layers are small, which leaves the layers before them no gradient to speak of.
      const at::Tensor values = parameter.detach();
      values.add_(at::empty_like(values).normal_(0.0, 0.1, generator));
      parameters.push_back(parameter.set_requires_grad(true));
    }
  }
  loss().backward();
  at::NoGradGuard no_grad;
  constexpr double kRounding = 0.01;  // of a loss of some 500, divided by twice the step
  size_t telling = 0;
  for (size_t i = 0; i < parameters.size(); ++i) {
    ASSERT_TRUE(parameters[i].grad().defined()) << i;
    const at::Tensor gradient = parameters[i].grad().to(at::kDouble);
    const double length = gradient.norm().item<double>();
    if (length > 3.0 * kRounding) ++telling;
    // Along the gradient, and another way.
    for (const at::Tensor& way :
         {gradient, at::empty_like(gradient).normal_(0.0, 1.0, generator)}) {
      const at::Tensor direction = way / way.norm().clamp_min(1e-30);
      const double slope = (gradient * direction).sum().item<double>();
      const double step = 0.005;  // ReLUs bend the loss
      const at::Tensor before = parameters[i].clone();
      parameters[i].copy_(before + step * direction);
      const double above = loss().item<double>();
      parameters[i].copy_(before - step * direction);
      const double below = loss().item<double>();
      parameters[i].copy_(before);
      EXPECT_NEAR((above - below) / (2.0 * step), slope, 0.03 * length + kRounding)
          << "parameter " << i << " " << parameters[i].sizes();
    }
  }
  EXPECT_GT(2 * telling, parameters.size()) << "most would show a gradient that is missing";
}

// The top-n loss of a model of fewer actions than n: each term, and each gradient.
TEST(SceneBoundTest, MoreActionsThanThereAreAreAll) {
  constexpr int kActions = 3;
  v1::TrainingSettings settings = TinyLanesSettings();
  settings.mutable_model()->set_actions(kActions);
  at::Generator generator = MakeGenerator(2);
  Networks networks(settings.model(), at::Device(at::kCPU), generator);
  const SceneLoader::Batch batch = ArcBatch(settings);
  using Part = Networks::Part;
  std::vector<at::Tensor> parameters;
  for (const Part part : {Part::kTrajectoryEncoder, Part::kDecoder, Part::kMixture, Part::kScene,
                          Part::kActions, Part::kScenarioEncoder}) {
    for (at::Tensor& parameter : networks.Parameters(part)) {
      parameters.push_back(parameter.set_requires_grad(true));
    }
  }
  // Returns the loss, and then the gradient of each parameter.
  const auto evaluate = [&](v1::Objective objective, int actions) {
    settings.mutable_optimization()->set_posterior_actions(actions);
    at::Generator noise = MakeGenerator(9);
    const NoiseSource draw = [&](at::IntArrayRef shape) {
      return at::empty(shape).normal_(0.0, 1.0, noise);
    };
    for (at::Tensor& parameter : parameters) parameter.mutable_grad() = at::Tensor();
    const SceneBatch scenes{batch.trajectories, networks.EncodeScenes(batch.scenes, {}), {}};
    const BoundTerms terms =
        SceneBound(networks, objective,
                   objective == v1::OBJECTIVE_DUAL ? Learning::kPosterior : Learning::kAll,
                   settings.optimization(), scenes, draw);
    const at::Tensor loss = Loss(terms, Weights(settings.optimization()));
    loss.backward();
    std::vector<at::Tensor> numbers = {loss.detach(), terms.posterior_reconstruction.detach(),
                                       terms.log_responsibilities.detach()};
    for (const at::Tensor& parameter : parameters) {
      numbers.push_back(parameter.grad().defined() ? parameter.grad().clone() : at::zeros({1}));
    }
    return numbers;
  };
  for (const auto& [objective, responsibilities] :
       {std::pair(v1::OBJECTIVE_UNIFIED, v1::RESPONSIBILITIES_PRINTED),
        {v1::OBJECTIVE_UNIFIED, v1::RESPONSIBILITIES_EXACT},
        {v1::OBJECTIVE_DUAL, v1::RESPONSIBILITIES_PRINTED}}) {
    settings.mutable_optimization()->set_responsibilities(responsibilities);
    const std::vector<at::Tensor> all = evaluate(objective, kActions);
    EXPECT_TRUE(std::isfinite(all[0].item<double>()));
    for (const int more : {kActions + 1, 6, 256}) {
      const std::vector<at::Tensor> others = evaluate(objective, more);
      for (size_t i = 0; i < all.size(); ++i) {
        EXPECT_TRUE(others[i].equal(all[i])) << objective << " " << more << " " << i;
      }
    }
    if (objective == v1::OBJECTIVE_UNIFIED && responsibilities == v1::RESPONSIBILITIES_EXACT) {
      continue;  // for which all are needed
    }
    EXPECT_FALSE(evaluate(objective, kActions - 1)[1].equal(all[1])) << objective;
  }
}

// A whole training, by responsibilities that let the top-n loss choose.
TEST(SceneBoundTest, AModelOfFewerActionsThanTheLossCountsLearnsFromAll) {
  constexpr int kActions = 3;
  const TemporaryFolder folder;
  TrainingRun run;
  run.settings = TinyLanesSettings();
  run.settings.mutable_model()->set_actions(kActions);
  v1::OptimizationSettings& optimization = *run.settings.mutable_optimization();
  optimization.set_responsibilities(v1::RESPONSIBILITIES_PRINTED);
  optimization.set_pretraining_epochs(1);
  optimization.set_mixture_epochs(1);
  optimization.set_joint_epochs(1);
  optimization.set_covariance_epochs(1);
  const TrainingData data = *SplitRecordings(ArcRecordings(40), run.settings);
  const auto learn = [&](int actions) {
    optimization.set_posterior_actions(actions);
    run.output = folder / std::to_string(actions);
    const auto manifest = Train(run, data);
    EXPECT_TRUE(manifest.ok()) << manifest.status();
    EXPECT_TRUE(manifest.ok() && std::isfinite(manifest->metrics().at("ade_1")));
    return files::ReadFile(run.output / "weights.safetensors").value_or("");
  };
  const std::string all = learn(kActions);
  EXPECT_TRUE(learn(6) == all);
  EXPECT_FALSE(learn(kActions - 1) == all);
}

}  // namespace
}  // namespace maneuver::learning::scene_vectors_test
