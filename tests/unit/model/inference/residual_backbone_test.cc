// The engine's residual networks against the reference's plain loops.

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <deque>
#include <filesystem>
#include <string>

#include "model/inference/action_model.h"
#include "model/inference/backbone.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/model/scene/raster_of.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::inference::residual_backbone_test {
namespace {

struct Network {
  const char* name;
  const char* residual;
};

// Odd sizes; blocks with a shortcut and without, with a stride and without; channels that fill no
// vector.
constexpr Network kNetworks[] = {
    {"Bottlenecks", R"pb(stem { channels: 12 kernel_size: 7 stride: 2 max_pool: true }
                         block: RESIDUAL_BLOCK_BOTTLENECK
                         stages { blocks: 2 width: 3 stride: 1 }
                         stages { blocks: 2 width: 5 stride: 2 })pb"},
    {"Vectors", R"pb(stem { channels: 32 kernel_size: 7 stride: 2 max_pool: true }
                     block: RESIDUAL_BLOCK_BOTTLENECK
                     stages { blocks: 2 width: 8 stride: 1 }
                     stages { blocks: 2 width: 16 stride: 2 })pb"},
    // All channels fill blocks of 16: Winograd's minimal filtering where there is AVX-512.
    {"Blocks", R"pb(stem { channels: 32 kernel_size: 7 stride: 2 max_pool: true }
                    block: RESIDUAL_BLOCK_BOTTLENECK
                    stages { blocks: 2 width: 16 stride: 1 }
                    stages { blocks: 2 width: 32 stride: 2 })pb"},
    {"BasicBlocksOf16", R"pb(stem { channels: 16 kernel_size: 3 stride: 1 }
                             block: RESIDUAL_BLOCK_BASIC
                             stages { blocks: 2 width: 16 stride: 1 }
                             stages { blocks: 2 width: 32 stride: 2 })pb"},
    {"BasicBlocks", R"pb(stem { channels: 6 kernel_size: 3 stride: 1 }
                         block: RESIDUAL_BLOCK_BASIC
                         stages { blocks: 2 width: 6 stride: 1 }
                         stages { blocks: 2 width: 9 stride: 2 }
                         stages { blocks: 1 width: 9 stride: 2 })pb"},
};

v1::ModelSpec Spec(const Network& network) {
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
        backbone { features: 24 }
        trajectory {
          waypoints: 3
          waypoint_interval { nanos: 500000000 }
        }
        actions: 4
        latent_dimensions: 2
        action_predictor { hidden: 8 }
        trajectory_encoder { hidden: 8 }
        decoder { hidden: 8 }
        scenario_encoder { hidden: 8 }
        decoder_stddev: 1
      )pb",
      &spec);
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(
      network.residual, spec.mutable_backbone()->mutable_residual()));
  return spec;
}

class ResidualBackboneTest : public testing::TestWithParam<Network> {
 protected:
  ResidualBackboneTest() : spec_(Spec(GetParam())), stored_(RandomModel(spec_, 3)) {
    const absl::Status written = artifact::WriteModelFolder(folder_, stored_);
    EXPECT_TRUE(written.ok()) << written;
  }

  std::unique_ptr<InferenceSession> NewSession(Precision precision) {
    const auto model = ActionModel::Load(folder_, {.precision = precision});
    EXPECT_TRUE(model.ok()) << model.status();
    return (*model)->NewSession();
  }

  std::vector<SceneEncoding> Encode(InferenceSession* session,
                                    const std::vector<std::vector<uint8_t>>& rasters) const {
    std::vector<SceneInputsView> scenes;
    std::deque<scene::Raster> drawn;
    for (const auto& raster : rasters) {
      drawn.push_back(scene::RasterOf(spec_.raster(), raster));
      scenes.push_back({&drawn.back(), {}});
    }
    std::vector<SceneEncoding> encodings(rasters.size());
    session->Encode(scenes, encodings);
    return encodings;
  }

  const v1::ModelSpec spec_;
  const artifact::StoredModel stored_;
  const TemporaryFolder parent_;
  const std::filesystem::path folder_ = parent_ / "model";
};

TEST_P(ResidualBackboneTest, EncodesAsTheReferenceDoes) {
  const ReferenceModel reference(stored_);
  const auto session = NewSession(Precision::kF32);
  for (uint32_t seed = 0; seed < 3; ++seed) {
    const auto raster = RandomRaster(spec_, seed);
    const SceneEncoding encoding = Encode(session.get(), {raster})[0];
    const auto features = reference.Features(raster);
    const auto expected = Eigen::Map<const Eigen::VectorXd>(
        features.data(), static_cast<Eigen::Index>(features.size()));
    ASSERT_GT(expected.norm(), 0.1);  // features that are all 0 would say nothing
    EXPECT_LE((encoding.features.cast<double>() - expected).norm(), 1e-5 * expected.norm());
    const auto probabilities = reference.Probabilities({features});
    for (size_t k = 0; k < probabilities.size(); ++k) {
      EXPECT_NEAR(encoding.probabilities[static_cast<Eigen::Index>(k)], probabilities[k], 1e-5);
    }
  }
}

TEST_P(ResidualBackboneTest, AnswersHaveTheSameBitsAloneAndInABatch) {
  const auto session = NewSession(Precision::kF32);
  std::vector<std::vector<uint8_t>> rasters;
  for (uint32_t seed = 0; seed < 8; ++seed) rasters.push_back(RandomRaster(spec_, seed));
  const auto together = Encode(session.get(), rasters);
  for (size_t i = rasters.size(); i-- > 0;) {
    const SceneEncoding alone = Encode(session.get(), {rasters[i]})[0];
    EXPECT_EQ(0, std::memcmp(alone.features.data(), together[i].features.data(),
                             sizeof(float) * static_cast<size_t>(alone.features.size())));
    EXPECT_EQ(0, std::memcmp(alone.probabilities.data(), together[i].probabilities.data(),
                             sizeof(double) * static_cast<size_t>(alone.probabilities.size())));
  }
}

TEST_P(ResidualBackboneTest, Bf16IsCloseToF32) {
  if (!ProcessorHasBf16()) GTEST_SKIP() << "this processor does not compute with bf16";
  const std::vector<std::vector<uint8_t>> raster = {RandomRaster(spec_, 1)};
  const auto rough = Encode(NewSession(Precision::kBf16).get(), raster)[0];
  const auto exact = Encode(NewSession(Precision::kF32).get(), raster)[0];
  const double difference = (rough.probabilities - exact.probabilities).cwiseAbs().maxCoeff();
  EXPECT_LT(difference, 0.01);
  EXPECT_GT(difference, 0.0);
}

INSTANTIATE_TEST_SUITE_P(All, ResidualBackboneTest, testing::ValuesIn(kNetworks),
                         [](const testing::TestParamInfo<Network>& network) {
                           return std::string(network.param.name);
                         });

}  // namespace
}  // namespace maneuver::inference::residual_backbone_test
