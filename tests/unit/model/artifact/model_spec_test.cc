#include "model/artifact/model_spec.h"

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <cstdint>

#include "model/artifact/backbone_layers.h"
#include "tests/unit/model/artifact/tiny_model.h"

namespace maneuver::artifact::model_spec_test {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::Pointwise;

std::vector<std::string> WrongFields(const v1::ModelSpec& spec) {
  std::vector<std::string> fields;
  for (const auto& violation : ValidateModelSpec(spec)) fields.push_back(violation.field);
  return fields;
}

TEST(ModelSpecTest, AcceptsAValidSpec) { EXPECT_THAT(WrongFields(TinySpec()), ElementsAre()); }

// A change of a valid spec, as text to merge, and the field that is then invalid.
struct Fault {
  const char* name;
  const char* change;
  const char* field;
};

class FaultySpecTest : public testing::TestWithParam<Fault> {};

TEST_P(FaultySpecTest, NamesTheField) {
  v1::ModelSpec spec = TinySpec();
  ASSERT_TRUE(google::protobuf::TextFormat::MergeFromString(GetParam().change, &spec));
  EXPECT_THAT(WrongFields(spec), ElementsAre(GetParam().field));
}

INSTANTIATE_TEST_SUITE_P(
    All, FaultySpecTest,
    testing::Values(
        Fault{"FlatRaster", "raster { height: 15 }", "raster.height"},
        Fault{"WideRaster", "raster { width: 513 }", "raster.width"},
        Fault{"PixelSize", "raster { meters_per_pixel: nan }", "raster.meters_per_pixel"},
        Fault{"TargetOnTheEdge", "raster { target_position: 1.0 }", "raster.target_position"},
        Fault{"NegativeFrames", "raster { history_frames: -1 }", "raster.history_frames"},
        Fault{"LongHistory", "raster { frame_interval { seconds: 11 } }", "raster.frame_interval"},
        Fault{"BackwardFrames", "raster { frame_interval { seconds: -1 } }",
              "raster.frame_interval"},
        Fault{"Stride", "backbone { convolutions { channels: 1 stride: 3 } }",
              "backbone.convolutions[2].stride"},
        Fault{"Channels", "backbone { convolutions { channels: 0 stride: 2 } }",
              "backbone.convolutions[2].channels"},
        Fault{"Features", "backbone { features: 5000 }", "backbone.features"},
        Fault{"FewestHistoryFrames", "raster { history_frames: -2147483648 }",
              "raster.history_frames"},
        Fault{"Waypoints", "trajectory { waypoints: 201 }", "trajectory.waypoints"},
        Fault{"Interval", "trajectory { waypoint_interval { nanos: 1000000000 } }",
              "trajectory.waypoint_interval"},
        Fault{"LongHorizon", "trajectory { waypoint_interval { seconds: 30 } }",
              "trajectory.waypoint_interval"},
        Fault{"OneAction", "actions: 1", "actions"},
        Fault{"Latent", "latent_dimensions: 33", "latent_dimensions"},
        Fault{"Predictor", "action_predictor { hidden: 0 }", "action_predictor.hidden[1]"},
        Fault{"Encoder", "trajectory_encoder { hidden: 4097 }", "trajectory_encoder.hidden[2]"},
        Fault{"Decoder", "decoder { hidden: [ 1, 1, 1, 1, 1, 1, 1, 1 ] }", "decoder.hidden"},
        Fault{"Scenario", "scenario_encoder { hidden: -1 }", "scenario_encoder.hidden[1]"},
        Fault{"Stddev", "decoder_stddev: -1", "decoder_stddev"},
        Fault{"TooManyWeights",
              "actions: 256 scenario_encoder { hidden: [ 4096, 4096, 4096, 4096 ] }",
              "scenario_encoder"},
        Fault{"TooLargeGrid",
              "raster { height: 512 width: 512 } backbone { convolutions { channels: 600 stride: 1 "
              "} }",
              "backbone.convolutions"},
        Fault{"TwoBackbones", "backbone { residual { block: RESIDUAL_BLOCK_BASIC } }",
              "backbone.residual"},
        Fault{"AgentWidth",
              "scene_vectors { history_width: 3 features: 4 agent_width: -1 agent_heads: 1 }",
              "scene_vectors.agent_width"},
        Fault{"AgentHeads",
              "scene_vectors { history_width: 3 features: 4 agent_width: 6 agent_heads: 4 }",
              "scene_vectors.agent_heads"},
        Fault{"PathHeads", "scene_vectors { history_width: 3 features: 4 path_width: 6 }",
              "scene_vectors.attention_heads"},
        Fault{"GeometryWithoutPaths",
              "scene_vectors { history_width: 3 features: 4 path_width: 0 } "
              "action_geometry { pair_width: 4 attention_heads: 2 features: 3 }",
              "action_geometry"},
        Fault{"GeometryOfNoWidth",
              "scene_vectors { history_width: 3 features: 4 path_width: 6 attention_heads: 2 } "
              "action_geometry { pair_width: 0 attention_heads: 2 features: 3 }",
              "action_geometry.pair_width"},
        Fault{"TypeTwice", "target_types: [ AGENT_TYPE_VEHICLE, AGENT_TYPE_VEHICLE ]",
              "target_types[1]"},
        Fault{"InputsOfALaterVersion", "inputs_version: 4", "inputs_version"},
        Fault{"TypeNotStated", "target_types: AGENT_TYPE_UNSPECIFIED", "target_types[0]"}),
    [](const testing::TestParamInfo<Fault>& fault) { return fault.param.name; });

TEST(ModelSpecTest, RefusesEveryPartOfAnEmptySpec) {
  const auto fields = WrongFields(v1::ModelSpec());
  for (const char* field : {"raster", "trajectory.waypoints", "actions", "latent_dimensions",
                            "decoder.hidden", "decoder_stddev"}) {
    EXPECT_THAT(fields, testing::Contains(field));
  }
  v1::ModelSpec empty_parts;
  empty_parts.mutable_raster();
  const auto of_raster = WrongFields(empty_parts);
  for (const char* field :
       {"raster.height", "raster.frame_interval", "backbone.convolutions", "backbone.features"}) {
    EXPECT_THAT(of_raster, testing::Contains(field));
  }
}

// Returns a spec with a residual backbone, changed by text.
v1::ModelSpec ResidualSpec(const char* change) {
  v1::ModelSpec spec = TinySpec();
  spec.mutable_backbone()->clear_convolutions();
  EXPECT_TRUE(google::protobuf::TextFormat::MergeFromString(
      R"pb(backbone {
             residual {
               stem { channels: 4 kernel_size: 5 stride: 2 max_pool: true }
               block: RESIDUAL_BLOCK_BOTTLENECK
               stages { blocks: 2 width: 1 stride: 1 }
               stages { blocks: 1 width: 2 stride: 2 }
             }
           })pb",
      &spec));
  EXPECT_TRUE(google::protobuf::TextFormat::MergeFromString(change, &spec));
  return spec;
}

TEST(ModelSpecTest, ChecksEachFieldOfAResidualBackbone) {
  EXPECT_THAT(WrongFields(ResidualSpec("")), ElementsAre());
  for (const auto& [change, field] : std::vector<std::pair<const char*, const char*>>{
           {"stem { channels: 2000 }", "stem.channels"},
           {"stem { kernel_size: 4 }", "stem.kernel_size"},
           {"stem { kernel_size: 13 }", "stem.kernel_size"},
           {"stem { kernel_size: -1 }", "stem.kernel_size"},
           {"stem { stride: 3 }", "stem.stride"},
           {"block: RESIDUAL_BLOCK_UNSPECIFIED", "block"},
           {"stages { blocks: 0 width: 1 stride: 1 }", "stages[2].blocks"},
           {"stages { blocks: 1 width: -1 stride: 1 }", "stages[2].width"},
           {"stages { blocks: 1 width: 1 stride: 4 }", "stages[2].stride"},
       }) {
    const std::string text = std::string("backbone { residual { ") + change + " } }";
    EXPECT_THAT(WrongFields(ResidualSpec(text.c_str())),
                ElementsAre(std::string("backbone.residual.") + field));
  }
  v1::ModelSpec none = ResidualSpec("");
  none.mutable_backbone()->mutable_residual()->clear_stages();
  EXPECT_THAT(WrongFields(none), ElementsAre("backbone.residual.stages"));
}

TEST(ModelSpecTest, TensorsOfAResidualBackboneAreNamedByStageAndBlock) {
  using Shape = std::vector<int64_t>;
  auto shapes = TensorShapes(ResidualSpec(""));
  EXPECT_EQ(shapes["backbone.stem.convolution.weight"], Shape({4, 7, 5, 5}));
  EXPECT_EQ(shapes["backbone.stem.normalization.bias"], Shape({4}));
  // 4 channels come in and 4 times width 1 go out: no shortcut.
  EXPECT_EQ(shapes["backbone.stage.0.block.0.convolution.0.weight"], Shape({1, 4, 1, 1}));
  EXPECT_EQ(shapes["backbone.stage.0.block.0.convolution.1.weight"], Shape({1, 1, 3, 3}));
  EXPECT_EQ(shapes["backbone.stage.0.block.0.convolution.2.weight"], Shape({4, 1, 1, 1}));
  EXPECT_FALSE(shapes.contains("backbone.stage.0.block.0.shortcut.convolution.weight"));
  EXPECT_EQ(shapes["backbone.stage.1.block.0.shortcut.convolution.weight"], Shape({8, 4, 1, 1}));
  EXPECT_EQ(shapes["backbone.stage.1.block.0.shortcut.normalization.running_var"], Shape({8}));
  // The average leaves one cell.
  EXPECT_EQ(shapes["backbone.projection.weight"], Shape({5, 8}));
}

TEST(ModelSpecTest, GridsFollowThePaddedStridedConvolutions) {
  // Output positions are those of a 3-wide window at -1, -1 + stride, ... with its centre in the
  // input.
  for (const int size : {16, 17, 18, 19, 31, 96, 225}) {
    for (const int stride : {1, 2}) {
      v1::ModelSpec spec = TinySpec();
      spec.mutable_raster()->set_height(size);
      spec.mutable_backbone()->mutable_convolutions(0)->set_stride(stride);
      int positions = 0;
      for (int centre = 0; centre < size; centre += stride) ++positions;
      EXPECT_EQ(BackboneLayers(spec)[0].output.height, positions) << size << " by " << stride;
    }
  }
  const GridSize input = RasterGrid(TinySpec().raster());
  EXPECT_EQ(input.channels, 3 + 2 + 2);
  EXPECT_EQ(input.height, 16);
  EXPECT_EQ(input.width, 20);
}

TEST(ModelSpecTest, ShapesMatchTheListInTensorH) {
  using Shape = std::vector<int64_t>;
  auto shapes = TensorShapes(TinySpec());
  EXPECT_EQ(shapes["backbone.convolution.0.weight"], Shape({4, 7, 3, 3}));
  EXPECT_EQ(shapes["backbone.convolution.1.weight"], Shape({6, 4, 3, 3}));
  EXPECT_EQ(shapes["backbone.normalization.1.running_var"], Shape({6}));
  EXPECT_EQ(shapes["backbone.projection.weight"], Shape({5, 6 * 8 * 10}));
  EXPECT_EQ(shapes["action_predictor.0.weight"], Shape({7, 5}));
  EXPECT_EQ(shapes["action_predictor.1.bias"], Shape({3}));
  EXPECT_EQ(shapes["trajectory_encoder.0.weight"], Shape({8, 6}));
  EXPECT_EQ(shapes["trajectory_encoder.1.weight"], Shape({9, 8}));
  EXPECT_EQ(shapes["trajectory_encoder.2.weight"], Shape({4, 9}));
  EXPECT_EQ(shapes["decoder.0.weight"], Shape({10, 2}));
  EXPECT_EQ(shapes["decoder.1.weight"], Shape({6, 10}));
  EXPECT_EQ(shapes["scenario_encoder.0.weight"], Shape({3, 11, 5}));
  EXPECT_EQ(shapes["scenario_encoder.1.bias"], Shape({3, 4}));
  EXPECT_EQ(shapes["mixture.mean"], Shape({3, 2}));
  EXPECT_EQ(shapes["mixture.log_weight"], Shape({3}));
  EXPECT_EQ(shapes["trajectory.stddev"], Shape({3, 2}));
  EXPECT_EQ(shapes["decoder.covariance"], Shape({3, 3, 3}));
  // 2 convolutions, a projection, 4 MLPs of 2, 3, 2 and 2 layers, and 6 tables.
  EXPECT_EQ(shapes.size(), 2u * 5 + 2 + 2 * (2 + 3 + 2 + 2) + 6);
}

TEST(ModelSpecTest, AModelThatReadsAgentsHasTheirLayersAndAWiderJoin) {
  using Shape = std::vector<int64_t>;
  v1::ModelSpec spec = TinySpec();
  spec.mutable_scene_vectors()->set_history_width(7);
  spec.mutable_scene_vectors()->set_features(9);
  auto without = TensorShapes(spec);
  EXPECT_FALSE(ReadsAgents(spec));
  EXPECT_EQ(without["join.weight"], Shape({9, 7 + 5}));
  spec.mutable_scene_vectors()->set_agent_width(0);
  EXPECT_EQ(TensorShapes(spec), without);
  spec.mutable_scene_vectors()->set_agent_width(6);
  spec.mutable_scene_vectors()->set_agent_heads(3);
  EXPECT_TRUE(ReadsAgents(spec));
  auto shapes = TensorShapes(spec);
  EXPECT_EQ(shapes["agent.0.weight"], Shape({6, 24}));
  EXPECT_EQ(shapes["agent.1.weight"], Shape({6, 6}));
  EXPECT_EQ(shapes["agent.history.weight"], Shape({6, 7}));
  EXPECT_EQ(shapes["agent.output.bias"], Shape({6}));
  EXPECT_EQ(shapes["agent.attention.weight"], Shape({3, 6}));
  EXPECT_EQ(shapes["join.weight"], Shape({9, 7 + 2 * 6 + 5}));
  EXPECT_EQ(shapes.size(), without.size() + 10);
}

TEST(ModelSpecTest, PredictsVehiclesUnlessItStatesOtherTypes) {
  v1::ModelSpec spec = TinySpec();
  EXPECT_TRUE(Predicts(spec, v1::AGENT_TYPE_VEHICLE));
  EXPECT_TRUE(Predicts(spec, v1::AGENT_TYPE_UNSPECIFIED));
  EXPECT_FALSE(Predicts(spec, v1::AGENT_TYPE_PEDESTRIAN));
  EXPECT_FALSE(Predicts(spec, v1::AGENT_TYPE_OTHER));
  EXPECT_EQ(TargetTypesText(spec), "vehicles");
  spec.add_target_types(v1::AGENT_TYPE_PEDESTRIAN);
  EXPECT_FALSE(Predicts(spec, v1::AGENT_TYPE_VEHICLE));
  EXPECT_TRUE(Predicts(spec, v1::AGENT_TYPE_UNSPECIFIED));
  EXPECT_TRUE(Predicts(spec, v1::AGENT_TYPE_PEDESTRIAN));
  spec.add_target_types(v1::AGENT_TYPE_CYCLIST);
  EXPECT_EQ(TargetTypesText(spec), "pedestrians and cyclists");
  spec.add_target_types(v1::AGENT_TYPE_VEHICLE);
  EXPECT_EQ(TargetTypesText(spec), "pedestrians, cyclists and vehicles");
}

TEST(ModelSpecTest, CurvesHaveAKnotAboutEvery0Point8SecondsOfAnyHorizon) {
  v1::TrajectorySpec spec;
  spec.mutable_waypoint_interval()->set_nanos(100'000'000);
  // Cubic splines that start at 0 have two more functions than intervals.
  for (const auto& [waypoints, functions] : {std::pair(30, 6), {50, 8}, {80, 12}, {3, 3}}) {
    spec.set_waypoints(waypoints);
    EXPECT_EQ(CurveFunctions(spec), functions) << waypoints;
  }
}

TEST(ModelSpecTest, WaypointsBeginOneIntervalAfterThePresent) {
  EXPECT_THAT(WaypointTimes(TinySpec().trajectory()),
              Pointwise(DoubleNear(1e-12), {0.1, 0.2, 0.3}));
  v1::TrajectorySpec spec;
  spec.set_waypoints(1);
  spec.mutable_waypoint_interval()->set_nanos(300'000'000);
  EXPECT_EQ(WaypointInterval(spec), 0.3);
  EXPECT_EQ(WaypointTimes(spec)[0], 0.3);
}

}  // namespace
}  // namespace maneuver::artifact::model_spec_test
