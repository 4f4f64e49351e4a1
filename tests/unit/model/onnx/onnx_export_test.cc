// Compares exported networks, evaluated by OpenCV, an independent engine, with this engine's
// answers for the same rasters.

#include "model/onnx/onnx_export.h"

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <numeric>
#include <opencv2/dnn.hpp>
#include <string>
#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "onnx_file.pb.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/onnx/engine_answers.h"
#include "tests/unit/model/scene/raster_of.h"

namespace maneuver::onnx::onnx_export_test {
namespace {

constexpr int kScenes = 3;

v1::ModelSpec Spec(const std::string& backbone, bool motion) {
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
  google::protobuf::TextFormat::ParseFromString(backbone, spec.mutable_backbone());
  spec.set_target_motion(motion);
  return spec;
}

v1::ModelSpec PlainSpec() {
  return Spec(R"pb(convolutions { channels: 12 stride: 2 }
                   convolutions { channels: 16 stride: 1 }
                   convolutions { channels: 21 stride: 2 }
                   features: 40)pb",
              true);
}

v1::ModelSpec ResidualSpec(const char* block) {
  return Spec(std::string(R"pb(residual {
                                 stem { channels: 12 kernel_size: 7 stride: 2 max_pool: true }
                                 stages { blocks: 2 width: 3 stride: 1 }
                                 stages { blocks: 2 width: 5 stride: 2 }
                                 block:)pb") +
                  block + "} features: 24",
              false);
}

v1::ModelSpec PresetSpec(const char* preset) {
  v1::TrainingSettings settings;
  settings.set_preset(preset);
  return artifact::ResolveTrainingSettings(settings).model();
}

// The inputs of both engines.
struct Scenes {
  std::deque<scene::Raster> rasters;
  std::vector<inference::SceneInputsView> inputs;
  cv::Mat raster;  // [N, C, H, W]
  cv::Mat motion;  // [N, 4]
};

Scenes MakeScenes(const v1::ModelSpec& spec) {
  const artifact::GridSize grid = artifact::RasterGrid(spec.raster());
  Scenes scenes;
  const int sizes[] = {kScenes, grid.channels, grid.height, grid.width};
  scenes.raster = cv::Mat(4, sizes, CV_32F);
  scenes.motion = cv::Mat(kScenes, scene::kMotionInputs, CV_32F);
  for (int n = 0; n < kScenes; ++n) {
    const auto bytes = inference::RandomRaster(spec, static_cast<uint32_t>(n));
    scenes.rasters.push_back(scene::RasterOf(spec.raster(), bytes));
    const uint8_t* byte = bytes.data();
    for (int row = 0; row < grid.height; ++row) {
      for (int column = 0; column < grid.width; ++column) {
        for (int c = 0; c < grid.channels; ++c) {
          const int place[] = {n, c, row, column};
          scenes.raster.at<float>(place) = static_cast<float>(*byte++) / 255.0f;
        }
      }
    }
    inference::SceneInputsView input{&scenes.rasters.back(), {}};
    for (int i = 0; i < scene::kMotionInputs; ++i) {
      input.motion[static_cast<size_t>(i)] = 0.3f * static_cast<float>(i - n);
      scenes.motion.at<float>(n, i) = input.motion[static_cast<size_t>(i)];
    }
    scenes.inputs.push_back(input);
  }
  return scenes;
}

Answers ExportedAnswers(const artifact::StoredModel& model, const Scenes& scenes) {
  const std::string file = ExportOnnx(model, {.distributions = true, .scenes = kScenes});
  cv::dnn::Net net = cv::dnn::readNetFromONNX(file.data(), file.size());
  net.setInput(scenes.raster, "raster");
  if (model.manifest.spec().target_motion()) net.setInput(scenes.motion, "motion");
  const std::vector<cv::String> names = {"features", "probabilities", "latent_mean",
                                         "latent_stddev", "trajectories"};
  std::vector<cv::Mat> outputs;
  net.forward(outputs, names);
  Answers answers;
  std::vector<double>* parts[] = {&answers.features, &answers.probabilities, &answers.latent_mean,
                                  &answers.latent_stddev, &answers.trajectories};
  for (size_t i = 0; i < outputs.size(); ++i) {
    const float* values = outputs[i].ptr<float>();
    parts[i]->assign(values, values + outputs[i].total());
  }
  return answers;
}

class OnnxExportTest : public testing::TestWithParam<std::pair<const char*, v1::ModelSpec>> {};

TEST_P(OnnxExportTest, AnotherEngineGivesTheSameAnswers) {
  const artifact::StoredModel model = inference::RandomModel(GetParam().second, 5);
  const Scenes scenes = MakeScenes(GetParam().second);
  const Answers ours = EngineAnswers(model, scenes.inputs);
  const Answers theirs = ExportedAnswers(model, scenes);
  ExpectSame(theirs, ours);
}

INSTANTIATE_TEST_SUITE_P(
    Networks, OnnxExportTest,
    testing::Values(std::pair("Plain", PlainSpec()),
                    std::pair("Bottlenecks", ResidualSpec("RESIDUAL_BLOCK_BOTTLENECK")),
                    std::pair("BasicBlocks", ResidualSpec("RESIDUAL_BLOCK_BASIC")),
                    std::pair("Compact", PresetSpec("compact"))),
    [](const auto& network) { return network.param.first; });

// Otherwise the comparison above would not detect a wrong weight.
TEST(OnnxExportTest, EveryExportedWeightAffectsTheAnswers) {
  const artifact::StoredModel model = inference::RandomModel(PlainSpec(), 5);
  const Scenes scenes = MakeScenes(PlainSpec());
  const Answers right = ExportedAnswers(model, scenes);
  for (const auto& [name, tensor] : model.weights) {
    artifact::StoredModel changed = model;
    for (float& value : changed.weights.at(name).values) value *= 1.01f;
    const Answers wrong = ExportedAnswers(changed, scenes);
    const double difference = InBounds(wrong, right);
    const bool left_out = name.starts_with("trajectory_encoder.") ||
                          name.starts_with("decoder.covariance") || name == "mixture.log_weight";
    if (left_out) {
      EXPECT_EQ(difference, 0.0) << name;
    } else {
      EXPECT_GT(difference, 10.0) << name;  // relative to the bounds of the comparison
    }
  }
}

TEST(OnnxExportTest, DistributionsCanBeLeftOut) {
  const artifact::StoredModel model = inference::RandomModel(PlainSpec(), 5);
  const Scenes scenes = MakeScenes(PlainSpec());
  const std::string file = ExportOnnx(model, {.distributions = false, .scenes = kScenes});
  EXPECT_LT(file.size(), ExportOnnx(model, {}).size());
  cv::dnn::Net net = cv::dnn::readNetFromONNX(file.data(), file.size());
  net.setInput(scenes.raster, "raster");
  net.setInput(scenes.motion, "motion");
  const cv::Mat probabilities = net.forward("probabilities");
  const std::vector<double> whole = ExportedAnswers(model, scenes).probabilities;
  ASSERT_EQ(probabilities.total(), whole.size());
  for (size_t i = 0; i < whole.size(); ++i) {
    EXPECT_EQ(static_cast<double>(probabilities.ptr<float>()[i]), whole[i]);
  }
}

TEST(OnnxExportTest, MetadataHasTheNamesOfTheActions) {
  artifact::StoredModel model = inference::RandomModel(PlainSpec(), 5);
  model.manifest.clear_actions();
  for (const char* name :
       {"keep straight", "left turn, tight", "reverse", "brake", "stop", "wait"}) {
    model.manifest.add_actions()->set_derived_name(name);
  }
  model.manifest.mutable_actions(1)->set_label("into \"Elm\" street");
  ModelProto file;
  ASSERT_TRUE(file.ParseFromString(ExportOnnx(model, {})));
  std::map<std::string, std::string> metadata;
  for (const StringStringEntryProto& entry : file.metadata_props()) {
    metadata[entry.key()] = entry.value();
  }
  EXPECT_EQ(metadata["action_names"],
            R"(["keep straight","into \"Elm\" street","reverse","brake","stop","wait"])");
}

}  // namespace
}  // namespace maneuver::onnx::onnx_export_test
