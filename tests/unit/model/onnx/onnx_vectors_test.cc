// Compares exported networks that read vectors, evaluated by an independent interpreter, with the
// engine's answers for the same scenes.

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/onnx/onnx_export.h"
#include "model/scene/action_geometry.h"
#include "model/scene/lane_paths.h"
#include "model/scene/motion_reference.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/onnx/engine_answers.h"
#include "tests/unit/model/onnx/onnx_interpreter.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::onnx::onnx_vectors_test {
namespace {

constexpr int kScenes = 3;
constexpr int kPathsOfScene[kScenes] = {2, 0, 6};
constexpr int kAgentsOfScene[kScenes] = {0, 12, 5};

v1::ModelSpec Changed(v1::ModelSpec spec, const char* changes) {
  EXPECT_TRUE(google::protobuf::TextFormat::MergeFromString(changes, &spec));
  EXPECT_THAT(artifact::ValidateModelSpec(spec), testing::IsEmpty());
  return spec;
}

// A model that reads only the target's history, in metres.
v1::ModelSpec HistorySpec() {
  return Changed({}, R"pb(
    scene_vectors { history_width: 9 features: 21 }
    trajectory {
      waypoints: 8
      waypoint_interval { nanos: 500000000 }
    }
    actions: 4
    latent_dimensions: 3
    action_predictor { hidden: [ 17 ] }
    trajectory_encoder { hidden: [ 16 ] }
    decoder { hidden: [ 18, 19 ] }
    scenario_encoder { hidden: [ 15 ] }
    decoder_stddev: 0.8
  )pb");
}

v1::ModelSpec PathSpec() {
  return Changed(HistorySpec(), R"pb(
    scene_vectors { path_width: 12 attention_heads: 3 }
    reference: TRAJECTORY_REFERENCE_CONSTANT_VELOCITY
  )pb");
}

v1::ModelSpec AgentSpec() {
  return Changed(HistorySpec(), R"pb(scene_vectors { agent_width: 12 agent_heads: 4 })pb");
}

v1::ModelSpec LanesSpec() {
  return Changed(PathSpec(), R"pb(
    scene_vectors { agent_width: 10 agent_heads: 2 }
    reference: TRAJECTORY_REFERENCE_FADING_MOTION
    action_geometry { pair_width: 6 attention_heads: 2 features: 11 }
    mean_residual: true
    scene_covariance { hidden: [ 5 ] }
  )pb");
}

v1::ModelSpec EverythingSpec() {
  return Changed(LanesSpec(), R"pb(
    raster {
      height: 18
      width: 20
      meters_per_pixel: 1
      target_position: 0.3
      history_frames: 2
      frame_interval { nanos: 500000000 }
    }
    backbone {
      convolutions { channels: 5 stride: 2 }
      convolutions { channels: 6 stride: 2 }
      features: 13
    }
  )pb");
}

// Writes a path that bends to one side; its other numbers are random.
void WritePath(double curvature, double offset, std::mt19937* generator, std::span<float> values) {
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  for (float& value : values) value = uniform(*generator);
  for (size_t n = 0; n < scene::kLanePathDistances.size(); ++n) {
    const double distance = scene::kLanePathDistances[n];
    const double angle = curvature * distance;
    const double unit = std::max(distance, 5.0);
    values[2 * n] = static_cast<float>(std::sin(angle) / curvature / unit);
    values[2 * n + 1] = static_cast<float>((offset + (1.0 - std::cos(angle)) / curvature) / unit);
    values[26 + n] = static_cast<float>(std::cos(angle));
    values[39 + n] = static_cast<float>(std::sin(angle));
  }
  values[62] = static_cast<float>(-offset);
  values[63] = 0.0f;
  values[64] = 1.0f;
  values[65] = 2.0f;
}

struct Scenes {
  std::deque<scene::Raster> rasters;
  std::deque<scene::SceneVectors> vectors;
  std::vector<inference::SceneInputsView> inputs;  // for this engine
  Arrays arrays;  // for the exported networks, without those of actions
};

Array NewArray(std::vector<int64_t> sizes) {
  int64_t count = 1;
  for (const int64_t size : sizes) count *= size;
  return {std::move(sizes), std::vector<double>(static_cast<size_t>(count))};
}

void AddRaster(const v1::ModelSpec& spec, int n, Scenes* scenes) {
  const artifact::GridSize grid = artifact::RasterGrid(spec.raster());
  const auto bytes = inference::RandomRaster(spec, static_cast<uint32_t>(n));
  scenes->rasters.push_back(scene::RasterOf(spec.raster(), bytes));
  Array& raster =
      scenes->arrays
          .try_emplace("raster", NewArray({kScenes, grid.channels, grid.height, grid.width}))
          .first->second;
  const int64_t pixels = int64_t{grid.height} * grid.width;
  for (int64_t p = 0; p < pixels; ++p) {
    for (int64_t c = 0; c < grid.channels; ++c) {
      raster.values[static_cast<size_t>((n * grid.channels + c) * pixels + p)] =
          bytes[static_cast<size_t>(p * grid.channels + c)] / 255.0;
    }
  }
}

Scenes MakeScenes(const v1::ModelSpec& spec) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  const std::vector<double> times = artifact::WaypointTimes(spec.trajectory());
  Scenes scenes;
  Array history = NewArray({kScenes, scene::kHistoryInputs});
  Array paths = NewArray({kScenes, scene::kMostLanePaths, scene::kLanePathInputs});
  Array mask = NewArray({kScenes, scene::kMostLanePaths});
  Array agents = NewArray({kScenes, scene::kMostNearAgents, scene::kAgentInputs});
  Array agent_mask = NewArray({kScenes, scene::kMostNearAgents});
  Array reference = NewArray({kScenes, spec.trajectory().waypoints(), 2});
  for (int n = 0; n < kScenes; ++n) {
    scene::SceneVectors& vectors = scenes.vectors.emplace_back();
    vectors.motion = {.speed = 4.0 + 5.0 * n, .acceleration = 1.0 - n, .turn_rate = 0.1 * n};
    for (float& value : vectors.history) value = uniform(generator);
    vectors.paths.count = artifact::ReadsLanePaths(spec) ? kPathsOfScene[n] : 0;
    for (int i = 0; i < vectors.paths.count; ++i) {
      WritePath(
          0.004 * (i + 1) * (i % 2 == 0 ? 1 : -1), 0.3 * i, &generator,
          std::span(vectors.paths.values)
              .subspan(static_cast<size_t>(i) * scene::kLanePathInputs, scene::kLanePathInputs));
      mask.values[static_cast<size_t>(n * scene::kMostLanePaths + i)] = 1.0;
    }
    std::copy(vectors.history.begin(), vectors.history.end(),
              history.values.begin() + n * scene::kHistoryInputs);
    std::copy(vectors.paths.values.begin(), vectors.paths.values.end(),
              paths.values.begin() + n * scene::kMostLanePaths * scene::kLanePathInputs);
    vectors.agents.count = artifact::ReadsAgents(spec) ? kAgentsOfScene[n] : 0;
    for (int i = 0; i < vectors.agents.count; ++i) {
      for (int j = 0; j < scene::kAgentInputs; ++j) {
        vectors.agents.values[static_cast<size_t>(i * scene::kAgentInputs + j)] =
            uniform(generator);
      }
      agent_mask.values[static_cast<size_t>(n * scene::kMostNearAgents + i)] = 1.0;
    }
    std::copy(vectors.agents.values.begin(), vectors.agents.values.end(),
              agents.values.begin() + n * scene::kMostNearAgents * scene::kAgentInputs);
    const size_t size = 2 * times.size();
    scene::RollOut(spec.reference(), spec.inputs_version(), vectors.motion, times,
                   std::span(reference.values).subspan(static_cast<size_t>(n) * size, size));
    if (spec.has_raster()) AddRaster(spec, n, &scenes);
    scenes.inputs.push_back(
        {spec.has_raster() ? &scenes.rasters.back() : nullptr, {}, &scenes.vectors.back()});
  }
  scenes.arrays.insert({{"history", history},
                        {"lane_paths", paths},
                        {"lane_path_mask", mask},
                        {"agents", agents},
                        {"agent_mask", agent_mask},
                        {"reference", reference}});
  return scenes;
}

// Adds what actions that look at the lanes read, as onnx_export.h says.
void AddActionInputs(const v1::ModelSpec& spec, const Array& generic, Scenes* scenes) {
  const int K = spec.actions();
  const int T = spec.trajectory().waypoints();
  const auto waypoints = scene::FindGeometryWaypoints(artifact::WaypointTimes(spec.trajectory()));
  Array& pairs = scenes->arrays["action_paths"];
  Array& numbers = scenes->arrays["action_numbers"];
  pairs.sizes = {kScenes, K, scene::kMostLanePaths, scene::kPairNumbers};
  numbers.sizes = {kScenes, K, scene::kActionNumbers};
  for (int n = 0; n < kScenes; ++n) {
    const double* reference =
        scenes->arrays.at("reference").values.data() + static_cast<ptrdiff_t>(n) * 2 * T;
    std::vector<scene::ActionPoints> points(static_cast<size_t>(K));
    for (int k = 0; k < K; ++k) {
      const double* own = generic.values.data() + static_cast<ptrdiff_t>(k) * 2 * T;
      for (size_t t = 0; t < scene::kGeometryTimes; ++t) {
        for (size_t axis = 0; axis < 2; ++axis) {
          const auto at = [&](int waypoint) {
            const size_t place = 2 * static_cast<size_t>(waypoint) + axis;
            return waypoint < 0 ? 0.0f : static_cast<float>(own[place] + reference[place]);
          };
          points[static_cast<size_t>(k)].at[t][axis] = at(waypoints.at[t]);
          points[static_cast<size_t>(k)].before[t][axis] = at(waypoints.before[t]);
        }
      }
    }
    std::vector<float> of_pairs(
        static_cast<size_t>(K * scene::kMostLanePaths * scene::kPairNumbers));
    std::vector<float> of_actions(static_cast<size_t>(K * scene::kActionNumbers));
    const scene::SceneVectors& vectors = scenes->vectors[static_cast<size_t>(n)];
    scene::DescribeActions(points, waypoints, vectors.paths, vectors.motion.speed,
                           spec.inputs_version(), of_pairs, of_actions);
    pairs.values.insert(pairs.values.end(), of_pairs.begin(), of_pairs.end());
    numbers.values.insert(numbers.values.end(), of_actions.begin(), of_actions.end());
  }
}

// Passes exactly the inputs that the file names: `scenes` may have more.
Answers ExportedAnswers(const artifact::StoredModel& model, const Scenes& scenes, int stated) {
  const std::string file = ExportOnnx(model, {.distributions = true, .scenes = stated});
  const Arrays answered = Evaluate(file, scenes.arrays);
  return {answered.at("features").values, answered.at("probabilities").values,
          answered.at("latent_mean").values, answered.at("latent_stddev").values,
          answered.at("trajectories").values};
}

Scenes CompleteScenes(const artifact::StoredModel& model) {
  const v1::ModelSpec& spec = model.manifest.spec();
  Scenes scenes = MakeScenes(spec);
  if (!spec.has_action_geometry()) return scenes;
  // The generic trajectories depend on no input.
  Arrays any = scenes.arrays;
  any["action_paths"] =
      NewArray({kScenes, spec.actions(), scene::kMostLanePaths, scene::kPairNumbers});
  any["action_numbers"] = NewArray({kScenes, spec.actions(), scene::kActionNumbers});
  AddActionInputs(spec, Evaluate(ExportOnnx(model, {}), any).at("generic_trajectories"), &scenes);
  return scenes;
}

class OnnxVectorsTest : public testing::TestWithParam<std::pair<const char*, v1::ModelSpec>> {};

TEST_P(OnnxVectorsTest, AnotherEngineGivesTheSameAnswers) {
  const artifact::StoredModel model = inference::RandomModel(GetParam().second, 5);
  const Scenes scenes = CompleteScenes(model);
  const Answers ours = EngineAnswers(model, scenes.inputs);
  ExpectSame(ExportedAnswers(model, scenes, kScenes), ours);
  ExpectSame(ExportedAnswers(model, scenes, 0), ours);
}

// Otherwise the comparison above would not detect a wrong weight.
TEST_P(OnnxVectorsTest, EveryExportedWeightAffectsTheAnswers) {
  const artifact::StoredModel model = inference::RandomModel(GetParam().second, 5);
  const Scenes scenes = CompleteScenes(model);
  const Answers right = ExportedAnswers(model, scenes, kScenes);
  for (const auto& [name, tensor] : model.weights) {
    artifact::StoredModel changed = model;
    for (float& value : changed.weights.at(name).values) value *= 1.05f;
    const double difference = InBounds(ExportedAnswers(changed, scenes, kScenes), right);
    const bool left_out = name.starts_with("trajectory_encoder.") ||
                          name.starts_with("decoder.covariance") ||
                          name.starts_with("scene_covariance.") || name == "mixture.log_weight";
    if (left_out) {
      EXPECT_EQ(difference, 0.0) << name;
    } else if (name.ends_with("attention.bias")) {
      EXPECT_LT(difference, 1e-3) << name;  // adds the same to all scores, which has no effect
    } else {
      EXPECT_GT(difference, 10.0) << name;  // relative to the bounds of the comparison
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Networks, OnnxVectorsTest,
                         testing::Values(std::pair("History", HistorySpec()),
                                         std::pair("Paths", PathSpec()),
                                         std::pair("Agents", AgentSpec()),
                                         std::pair("Lanes", LanesSpec()),
                                         std::pair("Everything", EverythingSpec())),
                         [](const auto& network) { return network.param.first; });

TEST(OnnxVectorsTest, DistributionsCanBeLeftOut) {
  const artifact::StoredModel model = inference::RandomModel(LanesSpec(), 5);
  Scenes scenes = CompleteScenes(model);
  const auto whole = Evaluate(ExportOnnx(model, {}), scenes.arrays).at("probabilities").values;
  scenes.arrays.erase("reference");
  const Arrays answered =
      Evaluate(ExportOnnx(model, {.distributions = false, .scenes = kScenes}), scenes.arrays);
  EXPECT_FALSE(answered.contains("trajectories"));
  EXPECT_EQ(answered.at("probabilities").values, whole);
}

}  // namespace
}  // namespace maneuver::onnx::onnx_vectors_test
