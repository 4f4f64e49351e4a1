#include "model/artifact/anchor_baselines.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <string>

#include "model/artifact/model_spec.h"
#include "model/artifact/training_presets.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::artifact::anchor_baselines_test {
namespace {

using google::protobuf::util::MessageDifferencer;

TEST(AnchorSpecTest, ReadsTheSceneLikeTheModelAndDecodesNoAction) {
  for (const char* preset : {"lanes", "lanes-metres", "compact"}) {
    v1::TrainingSettings settings;
    settings.set_preset(preset);
    const v1::ModelSpec model = ResolveTrainingSettings(settings).model();
    const v1::ModelSpec spec = AnchorSpec(model);
    EXPECT_THAT(ValidateModelSpec(spec), testing::IsEmpty()) << preset;
    EXPECT_EQ(spec.has_raster(), model.has_raster()) << preset;
    EXPECT_TRUE(MessageDifferencer::Equals(spec.raster(), model.raster())) << preset;
    EXPECT_TRUE(MessageDifferencer::Equals(spec.scene_vectors(), model.scene_vectors())) << preset;
    EXPECT_TRUE(MessageDifferencer::Equals(spec.trajectory(), model.trajectory())) << preset;
    EXPECT_EQ(spec.target_motion(), model.target_motion()) << preset;
    EXPECT_EQ(spec.reference(), model.reference()) << preset;
    EXPECT_EQ(spec.actions(), model.actions()) << preset;
    EXPECT_FALSE(spec.has_action_geometry()) << preset;
    EXPECT_FALSE(spec.mean_residual()) << preset;
    EXPECT_FALSE(spec.has_scene_covariance()) << preset;
    EXPECT_FALSE(spec.has_decoder_covariance()) << preset;
    // The predictor reads the same features.
    EXPECT_EQ(SceneFeatureCount(spec), SceneFeatureCount(model)) << preset;
  }
}

TEST(ReadBaselinesTest, NamesTheFileWhoseSpecIsWrong) {
  const TemporaryFolder folder;
  WriteBytes(folder / "baselines.json",
             R"({"format_version": 1, "spec": {"latent_dimensions": -2}})");
  const auto read = ReadBaselines(folder.path());
  EXPECT_EQ(read.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read.status().message()), testing::StartsWith("baselines.json: spec."));
}

}  // namespace
}  // namespace maneuver::artifact::anchor_baselines_test
