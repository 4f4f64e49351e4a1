// Residual backbones: how they begin, that a step trains them, and that the engine says what
// LibTorch says of them, ResNet-50 included.

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>

#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/inference/action_model.h"
#include "model/learning/learner.h"
#include "model/learning/networks.h"
#include "model/learning/phases/joint.h"
#include "model/scene/target_motion.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/model/learning/raster_batch_of.h"
#include "tests/unit/model/scene/raster_of.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::residual_network_test {
namespace {

// TinySettings with two bottleneck blocks in each of two stages.
v1::TrainingSettings SmallSettings() {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_optimization()->set_joint_epochs(1);
  v1::BackboneSpec& backbone = *settings.mutable_model()->mutable_backbone();
  backbone.clear_convolutions();
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(
      R"pb(stem { channels: 8 kernel_size: 7 stride: 2 max_pool: true }
           block: RESIDUAL_BLOCK_BOTTLENECK
           stages { blocks: 2 width: 4 stride: 1 }
           stages { blocks: 2 width: 8 stride: 2 })pb",
      backbone.mutable_residual()));
  return settings;
}

// The real ResNet-50, on 64 x 64 pixels and before small heads.
v1::TrainingSettings ResNet50Settings() {
  v1::TrainingSettings preset;
  preset.set_preset("resnet50");
  preset = artifact::ResolveTrainingSettings(preset);
  v1::TrainingSettings settings = SmallSettings();
  *settings.mutable_model()->mutable_backbone() = preset.model().backbone();
  *settings.mutable_model()->mutable_raster() = preset.model().raster();
  settings.mutable_model()->mutable_raster()->set_height(64);
  settings.mutable_model()->mutable_raster()->set_width(64);
  settings.mutable_examples()->set_max_examples(4);
  settings.mutable_optimization()->set_batch_size(4);  // one step
  return settings;
}

at::Tensor RandomRasters(const v1::RasterSpec& spec, int64_t count, at::Generator& generator) {
  const at::Tensor drawn =
      at::empty({count, spec.height(), spec.width(), 3 + 2 * spec.history_frames()}, at::kFloat)
          .uniform_(0.0, 1.0, generator);
  return at::where(drawn > 0.75, drawn * 255.0, at::zeros_like(drawn)).to(at::kByte);
}

// Moves batch normalisations away from where they begin, so that every part of them counts.
void VaryNormalizations(const v1::ModelSpec& spec, Networks* networks, at::Generator& generator) {
  at::NoGradGuard no_grad;
  for (const artifact::BackboneLayer& layer : artifact::BackboneLayers(spec)) {
    if (layer.kind != artifact::BackboneLayer::Kind::kConvolution) continue;
    const std::string& name = layer.normalization;
    (*networks)[name + ".weight"].uniform_(layer.adds ? 0.2 : 0.5, layer.adds ? 0.4 : 1.5,
                                           generator);
    (*networks)[name + ".bias"].uniform_(-0.5, 0.5, generator);
    (*networks)[name + ".running_mean"].uniform_(-0.5, 0.5, generator);
    (*networks)[name + ".running_var"].uniform_(0.5, 1.5, generator);
  }
}

class ResidualNetworkTest : public testing::TestWithParam<bool> {
 protected:
  const v1::TrainingSettings settings_ = GetParam() ? ResNet50Settings() : SmallSettings();
  const TemporaryFolder folder_;
};

TEST_P(ResidualNetworkTest, TrainsAStepExportsAndTheEngineAgreesWithLibTorch) {
  const v1::ModelSpec& spec = settings_.model();
  const TrainingData data = *SplitRecordings(ArcRecordings(8), settings_);
  const auto examples = static_cast<int64_t>(data.training.examples.size());
  TrainingProgress progress(Learner::Plan(settings_, {examples, examples, 0}), {},
                            [] { return std::chrono::system_clock::time_point(); });
  RankGroup alone([] { return false; });
  Learner learner(settings_, data, at::Device(at::kCPU), 1, alone, progress);
  Networks& networks = learner.state().networks;
  const Networks::Snapshot before = networks.Save();
  ASSERT_TRUE(TrainJointly(learner.state(), learner.loop()).ok());
  // A gamma of 0 lets no gradient into its block, but is itself reached by the first step.
  for (const artifact::BackboneLayer& layer : artifact::BackboneLayers(spec)) {
    if (layer.kind != artifact::BackboneLayer::Kind::kConvolution) continue;
    for (const char* part : {".weight", ".running_mean"}) {
      const std::string name = layer.normalization + part;
      if (std::string(part) == ".weight" && !layer.adds) continue;
      EXPECT_FALSE(networks[name].equal(before.at(name))) << name;
    }
  }

  at::Generator generator = MakeGenerator(5);
  VaryNormalizations(spec, &networks, generator);
  v1::ModelManifest manifest;
  *manifest.mutable_spec() = spec;
  const absl::Status written =
      artifact::WriteModelFolder(folder_ / "model", {manifest, networks.Export()});
  ASSERT_TRUE(written.ok()) << written;
  const auto model = inference::ActionModel::Load(folder_ / "model", {inference::Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();

  at::NoGradGuard no_grad;
  constexpr int64_t kScenes = 3;
  const at::Tensor rasters = RandomRasters(spec.raster(), kScenes, generator);
  const SceneFeatures encoded = networks.EncodeScenes(
      {.rasters = RasterBatchOf(rasters), .motions = at::zeros({kScenes, scene::kMotionInputs})},
      {});
  const at::Tensor features = encoded.features;
  const at::Tensor probabilities = networks.PredictActions(encoded).exp();
  std::vector<inference::SceneInputsView> scenes;
  std::deque<scene::Raster> drawn;
  for (int64_t i = 0; i < kScenes; ++i) {
    drawn.push_back(scene::RasterOf(
        spec.raster(), {rasters[i].data_ptr<uint8_t>(), scene::RasterBytes(spec.raster())}));
    scenes.push_back({&drawn.back(), {}});
  }
  std::vector<inference::SceneEncoding> encodings(scenes.size());
  (*model)->NewSession()->Encode(scenes, encodings);
  for (int64_t i = 0; i < kScenes; ++i) {
    inference::SceneEncoding& encoding = encodings[static_cast<size_t>(i)];
    const auto expect_close = [](const at::Tensor& expected, const at::Tensor& actual) {
      EXPECT_GT(expected.norm().item<double>(), 1e-3);
      EXPECT_LE((expected - actual).norm().item<double>(), 1e-4 * expected.norm().item<double>());
    };
    expect_close(features[i], at::from_blob(encoding.features.data(), {features.size(1)}));
    expect_close(probabilities[i].to(at::kDouble),
                 at::from_blob(encoding.probabilities.data(), {spec.actions()}, at::kDouble));
  }
}

INSTANTIATE_TEST_SUITE_P(All, ResidualNetworkTest, testing::Bool(),
                         [](const testing::TestParamInfo<bool>& resnet50) {
                           return resnet50.param ? "ResNet50" : "Small";
                         });

TEST(FreshResidualNetworkTest, FreshBlocksAddNothing) {
  at::NoGradGuard no_grad;
  const v1::ModelSpec spec = SmallSettings().model();
  at::Generator generator = MakeGenerator(5);
  Networks networks(spec, at::Device(at::kCPU), generator);
  const SceneTensors scenes{.rasters = RasterBatchOf(RandomRasters(spec.raster(), 2, generator)),
                            .motions = at::zeros({2, scene::kMotionInputs})};
  const at::Tensor fresh = networks.EncodeScenes(scenes, {}).features;
  for (const char* within : {"backbone.stage.0.block.1.convolution.0.weight",
                             "backbone.stage.1.block.0.convolution.2.weight"}) {
    networks[within].mul_(3.0);
  }
  EXPECT_TRUE(networks.EncodeScenes(scenes, {}).features.equal(fresh));
  networks["backbone.stage.1.block.0.shortcut.convolution.weight"].mul_(3.0);
  EXPECT_FALSE(networks.EncodeScenes(scenes, {}).features.equal(fresh));
}

}  // namespace
}  // namespace maneuver::learning::residual_network_test
