#include "model/artifact/model_cost.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/training_presets.h"
#include "tests/unit/model/artifact/tiny_model.h"

namespace maneuver::artifact::model_cost_test {
namespace {

v1::ModelSpec ResNet50() {
  v1::TrainingSettings settings;
  settings.set_preset("resnet50");
  return ResolveTrainingSettings(settings).model();
}

// ResNet-18 and -34 (basic blocks) and -50, as torchvision publishes them with their weights:
// parameters, and 1e9 multiply-adds for 224 x 224 pixels, 3 channels and 1000 classes. With the
// stride in the first 1x1 convolution of a bottleneck, the last would be 3.86.
TEST(ModelCostTest, ResNetsHaveTheirPublishedCosts) {
  struct Published {
    std::vector<int> blocks;
    v1::ResidualBlock block;
    int64_t parameters;
    double billions;
  };
  for (const Published& published :
       {Published{{2, 2, 2, 2}, v1::RESIDUAL_BLOCK_BASIC, 11'689'512, 1.814},
        Published{{3, 4, 6, 3}, v1::RESIDUAL_BLOCK_BASIC, 21'797'672, 3.664},
        Published{{3, 4, 6, 3}, v1::RESIDUAL_BLOCK_BOTTLENECK, 25'557'032, 4.089}}) {
    v1::ModelSpec spec = ResNet50();
    v1::BackboneSpec& backbone = *spec.mutable_backbone();
    backbone.set_features(1000);
    backbone.mutable_residual()->set_block(published.block);
    for (int s = 0; s < 4; ++s) {
      backbone.mutable_residual()->mutable_stages(s)->set_blocks(
          published.blocks[static_cast<size_t>(s)]);
    }
    // The additional cost of the stem for more than three channels.
    const int64_t taps = int64_t{64} * 7 * 7 * (RasterGrid(spec.raster()).channels - 3);
    const v1::ModelCost cost = CountCost(spec);
    EXPECT_EQ(cost.backbone_parameters() - taps, published.parameters);
    EXPECT_NEAR(static_cast<double>(cost.backbone_multiply_adds() - 112 * 112 * taps) * 1e-9,
                published.billions, 0.0005);
  }
}

// Counted by hand for TinySpec: 7 x 16 x 20 -> 4 x 8 x 10 -> 6 x 8 x 10 -> 5 features, 3 actions of
// 2 latent dimensions, 3 waypoints.
TEST(ModelCostTest, CountsEveryPartOnce) {
  const v1::ModelCost cost = CountCost(TinySpec());
  const int64_t backbone = 4 * 7 * 9 + 2 * 4 + 6 * 4 * 9 + 2 * 6 + 5 * 480 + 5;
  const int64_t predictor = 5 * 7 + 7 + 7 * 3 + 3;
  const int64_t encoder = 6 * 8 + 8 + 8 * 9 + 9 + 9 * 4 + 4;
  const int64_t decoder = 2 * 10 + 10 + 10 * 6 + 6;
  const int64_t scenario_encoder = 5 * 11 + 11 + 11 * 4 + 4;
  const int64_t mixture = 3 * 2 + 3 * 2 + 3;
  EXPECT_EQ(cost.backbone_parameters(), backbone);
  EXPECT_EQ(cost.parameters(),
            backbone + predictor + encoder + decoder + 3 * scenario_encoder + mixture);
  EXPECT_EQ(cost.backbone_multiply_adds(), 80 * 4 * 7 * 9 + 80 * 6 * 4 * 9 + 5 * 480);
  EXPECT_EQ(cost.predictor_multiply_adds(), 5 * 7 + 7 * 3);
  EXPECT_EQ(cost.distribution_multiply_adds(), 5 * 11 + 11 * 4 + 5 * (2 * 10 + 10 * 6));
}

// Returns the summed sizes of the tensors whose names start with `begin` and end in ".weight".
int64_t Weights(const v1::ModelSpec& spec, const std::string& begin) {
  int64_t sum = 0;
  for (const auto& [name, shape] : TensorShapes(spec)) {
    if (!absl::StartsWith(name, begin) || !absl::EndsWith(name, ".weight")) continue;
    int64_t count = 1;
    for (const int64_t size : shape) count *= size;
    sum += count;
  }
  return sum;
}

// Every weight multiplies once per scene, path, agent, action or pair that its layer is applied to.
TEST(ModelCostTest, CountsTheLayersThatReadVectorsAndLanes) {
  v1::TrainingSettings settings;
  settings.set_preset("lanes");
  const v1::ModelSpec spec = ResolveTrainingSettings(settings).model();
  const int64_t K = spec.actions();
  const int64_t P = spec.scene_vectors().path_width();
  const int64_t Q = spec.scene_vectors().agent_width();
  const int64_t G = spec.action_geometry().pair_width();
  const v1::ModelCost cost = CountCost(spec);
  EXPECT_EQ(cost.backbone_multiply_adds(), 0);
  EXPECT_EQ(cost.backbone_parameters(), 0);
  EXPECT_EQ(cost.vector_multiply_adds(),
            Weights(spec, "history.") + Weights(spec, "lane_path.history") +
                6 * (Weights(spec, "lane_path.0") + Weights(spec, "lane_path.1") +
                     Weights(spec, "lane_path.output") + Weights(spec, "lane_path.attention") + P) +
                Weights(spec, "agent.history") +
                12 * (Weights(spec, "agent.0") + Weights(spec, "agent.1") +
                      Weights(spec, "agent.output") + Weights(spec, "agent.attention") + Q) +
                Weights(spec, "join."));
  const auto geometry = [&](const std::string& layer) {
    return Weights(spec, "action_geometry." + layer + ".");
  };
  EXPECT_EQ(cost.predictor_multiply_adds(),
            Weights(spec, "action_predictor.") + geometry("scene") + 6 * geometry("path") +
                geometry("joint_scene") +
                6 * K * (geometry("pair") + geometry("hidden") + geometry("attention") + G) +
                K * (geometry("joint") + geometry("output") + geometry("logit")));
  EXPECT_EQ(cost.distribution_multiply_adds(),
            (Weights(spec, "scenario_encoder.") + Weights(spec, "mean_residual.") +
             Weights(spec, "scene_covariance.") + geometry("latent")) /
                    K +
                11 * Weights(spec, "decoder.") +
                TensorShapes(spec).at("mean_residual.curves")[0] *
                    TensorShapes(spec).at("mean_residual.curves")[1]);
}

}  // namespace
}  // namespace maneuver::artifact::model_cost_test
