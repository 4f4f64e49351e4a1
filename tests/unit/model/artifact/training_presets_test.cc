#include "model/artifact/training_presets.h"

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <string>

#include "model/artifact/model_spec.h"

namespace maneuver::artifact::training_presets_test {
namespace {

using testing::ElementsAre;

v1::TrainingSettings Settings(const std::string& text) {
  v1::TrainingSettings settings;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &settings)) << text;
  return settings;
}

v1::TrainingSettings Resolved(const std::string& text) {
  return ResolveTrainingSettings(Settings(text));
}

std::vector<std::string> WrongFields(const v1::TrainingSettings& settings) {
  std::vector<std::string> fields;
  for (const auto& violation : ValidateTrainingSettings(settings))
    fields.push_back(violation.field);
  return fields;
}

TEST(TrainingPresetsTest, PresetsAreValid) {
  EXPECT_THAT(WrongFields(Resolved("")), ElementsAre());
  EXPECT_THAT(WrongFields(Resolved("preset: 'paper'")), ElementsAre());
}

TEST(TrainingPresetsTest, LanesIsTheDefault) {
  EXPECT_EQ(Resolved("").SerializeAsString(), Resolved("preset: 'lanes'").SerializeAsString());
  EXPECT_EQ(Resolved("").preset(), "lanes");
  EXPECT_THAT(WrongFields(Resolved("preset: 'lanes-metres'")), ElementsAre());
  EXPECT_EQ(Resolved("preset: 'lanes-metres'").model().reference(), v1::TRAJECTORY_REFERENCE_NONE);
}

// docs/explanation/model.md states the effect of each.
TEST(TrainingPresetsTest, LanesLearnsExactResponsibilitiesWithWeightDecay) {
  const v1::OptimizationSettings lanes = Resolved("").optimization();
  EXPECT_EQ(lanes.responsibilities(), v1::RESPONSIBILITIES_EXACT);
  EXPECT_DOUBLE_EQ(lanes.weight_decay(), 0.1);
  for (const char* settings : {"preset: 'lanes-metres'", "preset: 'compact'", "preset: 'paper'"}) {
    const v1::OptimizationSettings others = Resolved(settings).optimization();
    EXPECT_EQ(others.responsibilities(), v1::RESPONSIBILITIES_PRINTED) << settings;
    EXPECT_DOUBLE_EQ(others.weight_decay(), 1e-4) << settings;
  }
}

// Callers from before `lanes` set sizes of the raster, when `compact` was the default preset.
TEST(TrainingPresetsTest, SettingsWithARasterGetTheCompactPreset) {
  for (const char* settings : {"model { raster { height: 96 } }", "model { target_motion: false }",
                               "model { backbone { features: 64 } }"}) {
    EXPECT_EQ(Resolved(settings).preset(), "compact") << settings;
    EXPECT_THAT(WrongFields(Resolved(settings)), ElementsAre()) << settings;
  }
}

TEST(TrainingPresetsTest, OnlyADualModelGetsPosteriorEpochs) {
  EXPECT_GT(Resolved("model { objective: OBJECTIVE_DUAL }").optimization().posterior_epochs(), 0);
  EXPECT_EQ(Resolved("").optimization().posterior_epochs(), 0);
}

TEST(TrainingPresetsTest, AChosenCovarianceTurnsOffTheSceneCovariance) {
  const v1::TrainingSettings learned =
      Resolved("optimization { decoder_covariance: DECODER_COVARIANCE_LEARNED }");
  EXPECT_FALSE(learned.model().has_scene_covariance());
  EXPECT_THAT(WrongFields(learned), ElementsAre());
}

TEST(TrainingPresetsTest, PaperHasTheSizesOfThePaper) {
  const v1::ModelSpec model = Resolved("preset: 'paper'").model();
  EXPECT_EQ(model.raster().height(), 224);
  EXPECT_EQ(model.raster().width(), 224);
  EXPECT_EQ(model.actions(), 25);
  EXPECT_EQ(model.latent_dimensions(), 5);
  for (const v1::MlpSpec& mlp : {model.action_predictor(), model.trajectory_encoder(),
                                 model.decoder(), model.scenario_encoder()}) {
    EXPECT_THAT(mlp.hidden(), ElementsAre(500, 500, 500));
  }
}

TEST(TrainingPresetsTest, ResNet50IsThePaperWithAnotherBackbone) {
  v1::TrainingSettings resnet = Resolved("preset: 'resnet50'");
  EXPECT_THAT(WrongFields(resnet), ElementsAre());
  v1::TrainingSettings paper = Resolved("preset: 'paper'");
  EXPECT_TRUE(resnet.model().backbone().convolutions().empty());
  EXPECT_EQ(resnet.model().backbone().residual().stages_size(), 4);
  EXPECT_EQ(resnet.model().backbone().features(), paper.model().backbone().features());
  for (v1::TrainingSettings* settings : {&resnet, &paper}) {
    settings->clear_preset();
    settings->mutable_model()->clear_backbone();
  }
  EXPECT_EQ(resnet.SerializeAsString(), paper.SerializeAsString());
}

TEST(TrainingPresetsTest, OneBackboneReplacesTheOther) {
  const v1::TrainingSettings plain =
      Resolved("preset: 'resnet50' model { backbone { convolutions { channels: 5 stride: 1 } } }");
  EXPECT_EQ(plain.model().backbone().convolutions_size(), 1);
  EXPECT_FALSE(plain.model().backbone().has_residual());
  const v1::TrainingSettings residual = Resolved(
      "model { backbone { residual { stem { channels: 8 kernel_size: 3 stride: 1 } "
      "block: RESIDUAL_BLOCK_BASIC stages { blocks: 1 width: 8 stride: 2 } } } }");
  EXPECT_TRUE(residual.model().backbone().convolutions().empty());
  EXPECT_THAT(WrongFields(residual), ElementsAre());
  // A field of the preset's own residual network only replaces itself.
  const v1::TrainingSettings basic =
      Resolved("preset: 'resnet50' model { backbone { residual { stem { max_pool: false } } } }");
  EXPECT_FALSE(basic.model().backbone().residual().stem().max_pool());
  EXPECT_EQ(basic.model().backbone().residual().stem().channels(), 64);
}

TEST(TrainingPresetsTest, NamesAnUnknownPresetAndLeavesTheSettingsAlone) {
  const v1::TrainingSettings resolved = Resolved("preset: 'large' seed: 3");
  EXPECT_EQ(resolved.SerializeAsString(), Settings("preset: 'large' seed: 3").SerializeAsString());
  EXPECT_THAT(WrongFields(resolved), ElementsAre("preset"));
}

TEST(TrainingPresetsTest, SetFieldsReplaceThoseOfThePresetAndNoOthers) {
  v1::TrainingSettings expected = Resolved("preset: 'compact'");
  expected.mutable_model()->mutable_raster()->set_height(64);
  expected.mutable_optimization()->set_joint_epochs(2);
  EXPECT_EQ(Resolved("model { raster { height: 64 } } optimization { joint_epochs: 2 }")
                .SerializeAsString(),
            expected.SerializeAsString());
}

TEST(TrainingPresetsTest, ARepeatedFieldReplacesAllElementsOfThePreset) {
  const v1::TrainingSettings resolved = Resolved(
      "model { decoder { hidden: 3 } backbone { convolutions { channels: 5 stride: 1 } } }");
  EXPECT_THAT(resolved.model().decoder().hidden(), ElementsAre(3));
  ASSERT_EQ(resolved.model().backbone().convolutions_size(), 1);
  EXPECT_EQ(resolved.model().backbone().convolutions(0).channels(), 5);
  EXPECT_GT(resolved.model().backbone().features(), 0);
}

TEST(TrainingPresetsTest, ADurationReplacesSecondsAndNanosOfThePreset) {
  // The presets' intervals have nanoseconds, which must not be added to these seconds.
  const v1::TrainingSettings resolved =
      Resolved("model { trajectory { waypoint_interval { seconds: 1 } } }");
  EXPECT_EQ(resolved.model().trajectory().waypoint_interval().seconds(), 1);
  EXPECT_EQ(resolved.model().trajectory().waypoint_interval().nanos(), 0);
}

TEST(TrainingPresetsTest, AugmentationCanBeTurnedOff) {
  EXPECT_TRUE(Resolved("").augmentation().mirror());
  const v1::TrainingSettings resolved =
      Resolved("augmentation { mirror: false scale: 0 shift_pixels: 0 }");
  EXPECT_FALSE(resolved.augmentation().mirror());
  EXPECT_EQ(resolved.augmentation().scale(), 0.0);
  EXPECT_EQ(resolved.augmentation().shift_pixels(), 0);
  EXPECT_THAT(WrongFields(resolved), ElementsAre());
}

TEST(TrainingPresetsTest, OnlyAPredictedCovarianceHasANetwork) {
  const v1::TrainingSettings predicted =
      Resolved("optimization { decoder_covariance: DECODER_COVARIANCE_PREDICTED }");
  EXPECT_THAT(predicted.model().decoder_covariance().hidden(), ElementsAre(64));
  EXPECT_THAT(WrongFields(predicted), ElementsAre());
  const v1::TrainingSettings other = Resolved(
      "model { decoder_covariance { hidden: 8 } }"
      "optimization { decoder_covariance: DECODER_COVARIANCE_LEARNED }");
  EXPECT_THAT(WrongFields(other), ElementsAre("model.decoder_covariance"));
}

TEST(TrainingPresetsTest, LiteralFollowsThePaper) {
  const v1::TrainingSettings literal = Resolved("preset: 'literal'");
  EXPECT_THAT(WrongFields(literal), ElementsAre());
  EXPECT_EQ(literal.optimization().mixture_epochs(), 0);
  EXPECT_EQ(literal.optimization().mixture_placement(), v1::MIXTURE_PLACEMENT_ENCODED_POINTS);
  EXPECT_EQ(literal.optimization().action_weight(), 1.0);
  EXPECT_EQ(literal.optimization().posterior_reconstruction_weight(), 1.0);
  EXPECT_EQ(literal.optimization().decoder_covariance(), v1::DECODER_COVARIANCE_FIXED);
  EXPECT_FALSE(literal.optimization().calibrate_probabilities());
  EXPECT_FALSE(literal.model().target_motion());
  EXPECT_FALSE(literal.augmentation().mirror());
  // The sizes are those of compact.
  EXPECT_EQ(literal.model().raster().SerializeAsString(),
            Resolved("preset: 'compact'").model().raster().SerializeAsString());
}

TEST(TrainingPresetsTest, OptionsOfAPresetCanBeTurnedOff) {
  EXPECT_TRUE(Resolved("preset: 'compact'").model().target_motion());
  EXPECT_TRUE(Resolved("").optimization().calibrate_probabilities());
  const v1::TrainingSettings off = Resolved(
      "model { target_motion: false } "
      "optimization { calibrate_probabilities: false dropout: 0 mixture_epochs: 0 }");
  EXPECT_FALSE(off.model().target_motion());
  EXPECT_FALSE(off.optimization().calibrate_probabilities());
  EXPECT_EQ(off.optimization().dropout(), 0.0);
  EXPECT_EQ(off.optimization().mixture_epochs(), 0);
  EXPECT_THAT(WrongFields(off), ElementsAre());
}

TEST(TrainingPresetsTest, ZeroWidthsTurnOffPartsOfLanes) {
  EXPECT_EQ(Resolved("").model().scene_vectors().agent_width(), 64);
  const v1::TrainingSettings no_agents = Resolved("model { scene_vectors { agent_width: 0 } }");
  EXPECT_FALSE(ReadsAgents(no_agents.model()));
  EXPECT_TRUE(ReadsLanePaths(no_agents.model()));
  EXPECT_TRUE(no_agents.model().has_action_geometry());
  EXPECT_THAT(WrongFields(no_agents), ElementsAre());
  const v1::TrainingSettings no_geometry = Resolved("model { action_geometry { pair_width: 0 } }");
  EXPECT_FALSE(no_geometry.model().has_action_geometry());
  EXPECT_TRUE(ReadsLanePaths(no_geometry.model()));
  EXPECT_THAT(WrongFields(no_geometry), ElementsAre());
  const v1::TrainingSettings history = Resolved(
      "model { scene_vectors { path_width: 0 agent_width: 0 } action_geometry { pair_width: 0 } }");
  EXPECT_FALSE(ReadsLanePaths(history.model()));
  EXPECT_FALSE(ReadsAgents(history.model()));
  EXPECT_GT(history.model().scene_vectors().history_width(), 0);
  EXPECT_THAT(WrongFields(history), ElementsAre());
}

// The server resolves settings, and its trainer resolves them again.
TEST(TrainingPresetsTest, ResolvedSettingsStayAsTheyAre) {
  std::vector<v1::TrainingSettings> all(1);
  for (const char* preset : {"compact", "lanes", "lanes-metres", "literal", "paper", "resnet50"}) {
    all.emplace_back().set_preset(preset);
  }
  all.emplace_back().mutable_model()->mutable_action_geometry()->set_pair_width(0);
  all.emplace_back().mutable_model()->mutable_scene_vectors()->set_agent_width(0);
  all.emplace_back().mutable_model()->set_mean_residual(false);
  all.emplace_back().mutable_optimization()->set_decoder_covariance(v1::DECODER_COVARIANCE_LEARNED);
  for (const v1::TrainingSettings& settings : all) {
    const v1::TrainingSettings resolved = ResolveTrainingSettings(settings);
    EXPECT_EQ(ResolveTrainingSettings(resolved).DebugString(), resolved.DebugString());
  }
}

TEST(TrainingPresetsTest, ActionsThatLookAtPathsNeedThem) {
  const v1::TrainingSettings settings = Resolved("model { scene_vectors { path_width: 0 } }");
  const auto violations = ValidateTrainingSettings(settings);
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].field, "model.action_geometry");
  EXPECT_THAT(violations[0].description, testing::HasSubstr("set action_geometry.pair_width to 0"));
}

struct Fault {
  const char* name;
  const char* change;
  const char* field;
};

class FaultySettingsTest : public testing::TestWithParam<Fault> {};

TEST_P(FaultySettingsTest, NamesTheField) {
  EXPECT_THAT(WrongFields(Resolved(GetParam().change)), ElementsAre(GetParam().field));
}

INSTANTIATE_TEST_SUITE_P(
    All, FaultySettingsTest,
    testing::Values(
        Fault{"Model", "model { actions: 1000 }", "model.actions"},
        Fault{"ModelLayer", "model { decoder { hidden: [ 3, -1 ] } }", "model.decoder.hidden[1]"},
        Fault{"AgentHeads", "model { scene_vectors { agent_heads: 3 } }",
              "model.scene_vectors.agent_heads"},
        Fault{"Stride", "examples { stride { seconds: -1 } }", "examples.stride"},
        Fault{"StrideOfANanosecond", "examples { stride { nanos: 1 } }", "examples.stride"},
        Fault{"TrainingStride", "examples { training_stride { nanos: 9999999 } }",
              "examples.training_stride"},
        Fault{"Placement", "optimization { mixture_placement: 99 }",
              "optimization.mixture_placement"},
        Fault{"Responsibilities", "optimization { responsibilities: 99 }",
              "optimization.responsibilities"},
        Fault{"DecoderCovariance", "preset: 'compact' optimization { decoder_covariance: 99 }",
              "optimization.decoder_covariance"},
        Fault{"Objective", "model { objective: 99 }", "model.objective"},
        Fault{"KeepStanding", "examples { keep_standing: 1.5 }", "examples.keep_standing"},
        Fault{"Standing", "examples { standing_distance: -1 }", "examples.standing_distance"},
        Fault{"Speed", "examples { max_speed: inf }", "examples.max_speed"},
        Fault{"Share", "examples { validation_share: 1 }", "examples.validation_share"},
        Fault{"Examples", "examples { max_examples: -1 }", "examples.max_examples"},
        Fault{"OneExample", "examples { max_examples: 1 }", "examples.max_examples"},
        Fault{"Pretraining", "optimization { pretraining_epochs: -1 }",
              "optimization.pretraining_epochs"},
        Fault{"Mixture", "optimization { mixture_epochs: 10001 }", "optimization.mixture_epochs"},
        Fault{"Joint", "optimization { joint_epochs: -7 }", "optimization.joint_epochs"},
        Fault{"Batch", "optimization { batch_size: 1 }", "optimization.batch_size"},
        Fault{"Rate", "optimization { learning_rate: 2 }", "optimization.learning_rate"},
        Fault{"LatentRate", "optimization { latent_learning_rate_share: -1 }",
              "optimization.latent_learning_rate_share"},
        Fault{"Decay", "optimization { weight_decay: nan }", "optimization.weight_decay"},
        Fault{"ActionWeight", "optimization { action_weight: -1 }", "optimization.action_weight"},
        Fault{"Reconstruction", "optimization { posterior_reconstruction_weight: 1e9 }",
              "optimization.posterior_reconstruction_weight"},
        Fault{"Divergence", "optimization { posterior_divergence_weight: -2 }",
              "optimization.posterior_divergence_weight"},
        Fault{"Posterior", "optimization { posterior_epochs: -1 }",
              "optimization.posterior_epochs"},
        Fault{"Placements", "optimization { placements: 65 }", "optimization.placements"},
        Fault{"Dropout", "optimization { dropout: 1 }", "optimization.dropout"},
        Fault{"Rotation", "augmentation { rotation: 2 }", "augmentation.rotation"},
        Fault{"DropAgents", "augmentation { drop_agents: 1 }", "augmentation.drop_agents"},
        Fault{"DropHistory", "augmentation { drop_history: -0.1 }", "augmentation.drop_history"},
        Fault{"Labels", "examples { label_share: 1.5 }", "examples.label_share"},
        Fault{"Scale", "augmentation { scale: 0.6 }", "augmentation.scale"},
        Fault{"Shift", "augmentation { shift_pixels: 1000 }", "augmentation.shift_pixels"},
        Fault{"Threads", "threads: -1", "threads"}, Fault{"Device", "device: 'tpu'", "device"}),
    [](const testing::TestParamInfo<Fault>& fault) { return fault.param.name; });

v1::ModelSpec StartSpec() {
  return Resolved("preset: 'paper' model { actions: 7 objective: OBJECTIVE_BASE }").model();
}

TEST(StartTest, UsesTheSpecOfTheStartExceptForAChosenObjective) {
  const v1::TrainingSettings kept =
      ResolveTrainingSettings(Settings("optimization { joint_epochs: 3 }"), StartSpec());
  EXPECT_EQ(kept.model().SerializeAsString(), StartSpec().SerializeAsString());
  EXPECT_EQ(kept.optimization().joint_epochs(), 3);
  EXPECT_EQ(kept.optimization().batch_size(),
            Resolved("preset: 'compact'").optimization().batch_size());
  const v1::TrainingSettings dual =
      ResolveTrainingSettings(Settings("model { objective: OBJECTIVE_DUAL }"), StartSpec());
  EXPECT_EQ(dual.model().objective(), v1::OBJECTIVE_DUAL);
  EXPECT_EQ(dual.model().actions(), 7);
  EXPECT_THAT(WrongFields(dual), ElementsAre());
}

TEST(StartTest, RefusesSettingsThatContradictTheStart) {
  const auto wrong = [](const std::string& text) {
    std::vector<std::string> fields;
    for (const auto& violation : ValidateStart(Settings(text), StartSpec())) {
      fields.push_back(violation.field);
    }
    return fields;
  };
  EXPECT_THAT(wrong(""), ElementsAre());
  EXPECT_THAT(wrong("model { actions: 7 decoder { hidden: 500 hidden: 500 hidden: 500 } }"),
              ElementsAre());
  EXPECT_THAT(wrong("model { actions: 8 }"), ElementsAre("model"));
  EXPECT_THAT(wrong("model { decoder { hidden: 12 } }"), ElementsAre("model"));
  EXPECT_THAT(wrong("optimization { weight_concentration: 0.1 }"),
              ElementsAre("optimization.weight_concentration"));
  EXPECT_THAT(wrong("optimization { decoder_covariance: DECODER_COVARIANCE_PREDICTED }"),
              ElementsAre("optimization.decoder_covariance"));
  const auto message = ValidateStart(Settings("model { actions: 8 }"), StartSpec())[0].description;
  EXPECT_NE(message.find("actions: 7 -> 8"), std::string::npos) << message;
}

// Folders from before models read agents have no such field.
TEST(StartTest, AnUnsetWidthEqualsZero) {
  v1::ModelSpec start = Resolved("").model();
  start.mutable_scene_vectors()->clear_agent_width();
  start.mutable_scene_vectors()->clear_agent_heads();
  EXPECT_FALSE(ReadsAgents(ResolveTrainingSettings(Settings(""), start).model()));
  const auto wrong = [&start](const std::string& text) {
    return ValidateStart(Settings("model { " + text + " }"), start).size();
  };
  EXPECT_EQ(wrong("scene_vectors { agent_width: 0 }"), 0u);
  EXPECT_EQ(wrong("scene_vectors { agent_width: 64 }"), 1u);
  EXPECT_EQ(wrong("scene_vectors { path_width: 0 }"), 1u);
  EXPECT_EQ(wrong("action_geometry { pair_width: 0 }"), 1u);
}

TEST(StartTest, ACovarianceNetworkOfTheStartIsKept) {
  const v1::ModelSpec spec =
      Resolved("optimization { decoder_covariance: DECODER_COVARIANCE_PREDICTED }").model();
  const v1::TrainingSettings resolved = ResolveTrainingSettings(Settings(""), spec);
  EXPECT_TRUE(resolved.model().has_decoder_covariance());
  EXPECT_THAT(WrongFields(resolved), ElementsAre());
}

TEST(TrainingPresetsTest, WeightsOfDatasetsArePositive) {
  EXPECT_THAT(WrongFields(Resolved("examples { dataset_weights: 1 dataset_weights: 0 }")),
              ElementsAre("examples.dataset_weights[1]"));
}

TEST(TrainingPresetsTest, ListsSixteenWrongFieldsAndCountsTheOthers) {
  v1::TrainingSettings settings;
  settings.mutable_examples()->mutable_dataset_weights()->Resize(1000, -1.0);
  const auto violations = ValidateTrainingSettings(ResolveTrainingSettings(settings));
  ASSERT_EQ(violations.size(), 16u);
  EXPECT_EQ(violations[15].field, "examples.dataset_weights[15]");
  EXPECT_EQ(violations[15].others, 984);
}

}  // namespace
}  // namespace maneuver::artifact::training_presets_test
