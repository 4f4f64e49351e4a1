#include "model/artifact/training_presets.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "model/artifact/field_rules.h"
#include "model/artifact/model_spec.h"

namespace maneuver::artifact {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr int kDualPosteriorEpochs = 6;
constexpr int kCovarianceWidth = 64;  // of the predicted covariance's hidden layer

const std::set<std::string>& Presets() {
  static const auto& presets = *new std::set<std::string>{"compact", "lanes", "lanes-metres",
                                                          "literal", "paper", "resnet50"};
  return presets;
}

// Returns the preset of settings that name none. Settings with a raster belong to the raster's
// preset.
std::string DefaultPreset(const v1::ModelSpec& model) {
  return model.has_raster() || model.has_backbone() || model.has_target_motion() ? "compact"
                                                                                 : "lanes";
}

// What all presets share.
constexpr char kLearning[] = R"pb(
  examples {
    stride { nanos: 500000000 }
    keep_standing: 0.06
    standing_distance: 1.5
    max_speed: 45
    validation_share: 0.15
  }
  optimization {
    pretraining_epochs: 60
    mixture_epochs: 300
    joint_epochs: 10
    batch_size: 64
    learning_rate: 1e-3
    latent_learning_rate_share: 0.1
    weight_decay: 1e-4
    action_weight: 5
    posterior_reconstruction_weight: 0.05
    posterior_divergence_weight: 1
    posterior_epochs: 6
    responsibilities: RESPONSIBILITIES_PRINTED
    mixture_placement: MIXTURE_PLACEMENT_VELOCITY_CLUSTERS
    clustered_share: 0.9
    slow_speed: 1
    placements: 1
    decoder_covariance: DECODER_COVARIANCE_LEARNED
    dropout: 0.2
    calibrate_probabilities: true
    calibrate_latent: true
    covered_share: 0.83
  }
  augmentation {
    mirror: true
    scale: 0.1
    shift_pixels: 1
    rotation: 0
    drop_agents: 0
    drop_history: 0
  }
  seed: 1
  device: "cpu"
)pb";

// Trains in minutes on two cores.
constexpr char kCompact[] = R"pb(
  preset: "compact"
  model {
    raster {
      height: 64
      width: 64
      meters_per_pixel: 1.6
      target_position: 0.3
      history_frames: 5
      frame_interval { nanos: 250000000 }
    }
    backbone {
      convolutions { channels: 24 stride: 2 }
      convolutions { channels: 48 stride: 2 }
      convolutions { channels: 64 stride: 2 }
      convolutions { channels: 96 stride: 2 }
      features: 256
    }
    trajectory {
      waypoints: 50
      waypoint_interval { nanos: 100000000 }
    }
    actions: 25
    latent_dimensions: 5
    action_predictor { hidden: [ 128, 128, 128 ] }
    trajectory_encoder { hidden: [ 128, 128, 128 ] }
    decoder { hidden: [ 128, 128, 128 ] }
    scenario_encoder { hidden: [ 128, 128, 128 ] }
    decoder_stddev: 1.0
    objective: OBJECTIVE_UNIFIED
    target_motion: true
  }
  examples { max_examples: 12000 }
)pb";

// On top of compact: the paper taken literally (sections III-B to III-E), for comparison.
constexpr char kLiteral[] = R"pb(
  preset: "literal"
  model { target_motion: false }
  optimization {
    mixture_epochs: 0
    clustered_share: 0
    posterior_epochs: 0
    latent_learning_rate_share: 1
    action_weight: 1
    posterior_reconstruction_weight: 1
    posterior_divergence_weight: 1
    mixture_placement: MIXTURE_PLACEMENT_ENCODED_POINTS
    decoder_covariance: DECODER_COVARIANCE_FIXED
    dropout: 0
    calibrate_probabilities: false
    calibrate_latent: false
    covered_share: 0
  }
  augmentation { mirror: false scale: 0 shift_pixels: 0 }
)pb";

// The sizes in the paper: section III-E (224 x 224 pixels, hidden layers of 500 nodes, K = 25, D =
// 5).
constexpr char kPaper[] = R"pb(
  preset: "paper"
  model {
    raster {
      height: 224
      width: 224
      meters_per_pixel: 0.5
      target_position: 0.3
      history_frames: 11
      frame_interval { nanos: 100000000 }
    }
    backbone {
      convolutions { channels: 32 stride: 2 }
      convolutions { channels: 64 stride: 2 }
      convolutions { channels: 96 stride: 2 }
      convolutions { channels: 128 stride: 2 }
      convolutions { channels: 192 stride: 2 }
      features: 512
    }
    trajectory {
      waypoints: 50
      waypoint_interval { nanos: 100000000 }
    }
    actions: 25
    latent_dimensions: 5
    action_predictor { hidden: [ 500, 500, 500 ] }
    trajectory_encoder { hidden: [ 500, 500, 500 ] }
    decoder { hidden: [ 500, 500, 500 ] }
    scenario_encoder { hidden: [ 500, 500, 500 ] }
    decoder_stddev: 1.0
    objective: OBJECTIVE_UNIFIED
    target_motion: false
  }
)pb";

// On top of paper: the backbone of its experiments, ResNet-50 (v1.5; the sizes of He et al., table
// 1). The preset "paper" has five convolutions for the "much smaller CNN" of section III-E.
constexpr char kResNet50[] = R"pb(
  preset: "resnet50"
  model {
    backbone {
      residual {
        stem { channels: 64 kernel_size: 7 stride: 2 max_pool: true }
        block: RESIDUAL_BLOCK_BOTTLENECK
        stages { blocks: 3 width: 64 stride: 1 }
        stages { blocks: 4 width: 128 stride: 2 }
        stages { blocks: 6 width: 256 stride: 2 }
        stages { blocks: 3 width: 512 stride: 2 }
      }
    }
  }
)pb";

// Reads the target's history, the lane paths and nearby agents as vectors, predicts what the target
// does beyond its present motion, and lets actions look at the lanes. Differs from the paper's
// model: x is relative to a reference, and its mean depends on the scene (mean_residual).
constexpr char kLanes[] = R"pb(
  preset: "lanes"
  model {
    trajectory {
      waypoints: 50
      waypoint_interval { nanos: 100000000 }
    }
    actions: 25
    latent_dimensions: 5
    action_predictor { hidden: [ 128 ] }
    trajectory_encoder { hidden: [ 128, 128, 128 ] }
    decoder { hidden: [ 128, 128, 128 ] }
    scenario_encoder { hidden: [ 64 ] }
    decoder_stddev: 1.0
    objective: OBJECTIVE_UNIFIED
    reference: TRAJECTORY_REFERENCE_FADING_MOTION
    scene_vectors {
      history_width: 64
      path_width: 96
      attention_heads: 4
      features: 256
      agent_width: 64
      agent_heads: 2
    }
    action_geometry { pair_width: 32 attention_heads: 2 features: 64 }
    mean_residual: true
    scene_covariance { hidden: [ 32 ] }
    inputs_version: 3
  }
  examples {
    validation_share: 0.05
    max_examples: 12000
    training_stride { nanos: 200000000 }
  }
  optimization {
    mixture_epochs: 100
    joint_epochs: 20
    posterior_epochs: 0
    covariance_epochs: 6
    batch_size: 128
    learning_rate: 1.4e-3
    weight_decay: 0.1
    responsibilities: RESPONSIBILITIES_EXACT
    posterior_reconstruction_weight: 0.4
    posterior_huber: 1
    posterior_actions: 6
    mixture_placement: MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS
    clustered_share: 0.85
    decoder_covariance: DECODER_COVARIANCE_SCENE
    geometry_dropout: 0.1
    covered_share: 0.865
    calibrate_latent: false
  }
  augmentation { shift_pixels: 0 sensor_noise: 0.5 }
)pb";

// On top of lanes: actions are positions in the target's frame, as in the paper.
constexpr char kLanesMetres[] = R"pb(
  preset: "lanes-metres"
  model { reference: TRAJECTORY_REFERENCE_NONE }
  optimization {
    weight_decay: 1e-4
    responsibilities: RESPONSIBILITIES_PRINTED
    mixture_placement: MIXTURE_PLACEMENT_VELOCITY_CLUSTERS
  }
)pb";

// Clears the fields of `preset` that `settings` replaces as a whole. Merging would append to
// repeated fields, and mix seconds of one duration with nanoseconds of another.
void ClearReplaced(const Message& settings, Message* preset) {
  std::vector<const FieldDescriptor*> fields;
  settings.GetReflection()->ListFields(settings, &fields);
  for (const FieldDescriptor* field : fields) {
    if (field->is_repeated()) {
      preset->GetReflection()->ClearField(preset, field);
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (field->message_type() == google::protobuf::Duration::descriptor()) {
        preset->GetReflection()->ClearField(preset, field);
      } else {
        ClearReplaced(settings.GetReflection()->GetMessage(settings, field),
                      preset->GetReflection()->MutableMessage(preset, field));
      }
    }
  }
}

// Returns whether a spec describes a model from its inputs to its trajectories.
bool IsWhole(const v1::ModelSpec& spec) {
  return (spec.has_raster() || spec.has_scene_vectors()) && spec.has_trajectory() &&
         spec.actions() > 0 && spec.latent_dimensions() > 0 && spec.has_action_predictor() &&
         spec.has_trajectory_encoder() && spec.has_decoder() && spec.has_scenario_encoder() &&
         spec.decoder_stddev() > 0.0 && spec.objective() != v1::OBJECTIVE_UNSPECIFIED;
}

// Sets the fields of `preset` that are set in `settings`.
void Replace(const v1::TrainingSettings& settings, v1::TrainingSettings* preset) {
  ClearReplaced(settings, preset);
  // One backbone replaces the other.
  if (settings.model().backbone().has_residual()) {
    preset->mutable_model()->mutable_backbone()->clear_convolutions();
  }
  if (settings.model().backbone().convolutions_size() > 0) {
    preset->mutable_model()->mutable_backbone()->clear_residual();
  }
  preset->MergeFrom(settings);
  // Settings that were resolved before, by the server for its trainer, are whole, and lack what was
  // turned off.
  const bool lacks = IsWhole(settings.model()) && !settings.model().has_action_geometry();
  if (lacks || (settings.model().action_geometry().has_pair_width() &&
                settings.model().action_geometry().pair_width() == 0)) {
    preset->mutable_model()->clear_action_geometry();
  }
}

v1::TrainingSettings ParsePreset(std::initializer_list<const char*> texts) {
  v1::TrainingSettings preset;
  for (const char* text : texts) {
    v1::TrainingSettings part;
    // These texts are constants of this file, so failing to parse is a bug.
    if (!google::protobuf::TextFormat::ParseFromString(text, &part)) std::abort();
    Replace(part, &preset);
  }
  return preset;
}

void CheckExamples(const v1::ExampleSettings& examples, FieldRules* rules) {
  const auto check_stride = [rules](const char* field, const google::protobuf::Duration& stride) {
    if (!rules->Positive(field, stride)) return;
    rules->Require(stride.seconds() > 0 || stride.nanos() >= kLeastStride * 1e9, field,
                   absl::StrCat("must be at least ", kLeastStride, " s"));
  };
  check_stride("examples.stride", examples.stride());
  if (examples.has_training_stride()) {
    check_stride("examples.training_stride", examples.training_stride());
  }
  rules->Require(examples.keep_standing() > 0 && examples.keep_standing() <= 1,
                 "examples.keep_standing", "must be more than 0 and at most 1");
  rules->Between("examples.standing_distance", "metres", examples.standing_distance(), 0.0, 100.0);
  rules->Between("examples.max_speed", "metres per second", examples.max_speed(), 1.0, 200.0);
  rules->Require(examples.validation_share() >= 0 && examples.validation_share() < 1,
                 "examples.validation_share", "must be at least 0 and less than 1");
  rules->Between("examples.label_share", "share", examples.label_share(), 0.0, 1.0);
  // An epoch of one example has no step: batch normalisation needs two.
  rules->Require(examples.max_examples() == 0 || examples.max_examples() >= 2,
                 "examples.max_examples", "must be at least 2, or 0 for all examples");
  for (int i = 0; i < examples.dataset_weights_size(); ++i) {
    const double weight = examples.dataset_weights(i);
    rules->Require(weight > 0.0 && weight <= 1e6, absl::StrCat("examples.dataset_weights[", i, "]"),
                   "must be more than 0 and at most 1000000");
  }
}

void CheckOptimization(const v1::OptimizationSettings& optimization, v1::Objective objective,
                       FieldRules* rules) {
  constexpr char kUnknown[] = "is not one that this version knows";
  rules->Require(v1::MixturePlacement_IsValid(optimization.mixture_placement()),
                 "optimization.mixture_placement", kUnknown);
  rules->Require(v1::Responsibilities_IsValid(optimization.responsibilities()),
                 "optimization.responsibilities", kUnknown);
  rules->Require(v1::DecoderCovariance_IsValid(optimization.decoder_covariance()),
                 "optimization.decoder_covariance", kUnknown);
  const auto check_epochs = [rules](const char* field, int epochs, int fewest = 1) {
    rules->Between(field, "epochs", epochs, fewest, 10'000);
  };
  check_epochs("optimization.pretraining_epochs", optimization.pretraining_epochs());
  check_epochs("optimization.mixture_epochs", optimization.mixture_epochs(), 0);
  check_epochs("optimization.joint_epochs", optimization.joint_epochs());
  check_epochs("optimization.posterior_epochs", optimization.posterior_epochs(),
               objective == v1::OBJECTIVE_DUAL ? 1 : 0);
  rules->Between("optimization.placements", "placements", optimization.placements(), 1, 64);
  rules->Between("optimization.clustered_share", "share", optimization.clustered_share(), 0.0, 1.0);
  rules->Require(optimization.divergence_warm_up() >= 0 && optimization.divergence_warm_up() < 1,
                 "optimization.divergence_warm_up", "must be at least 0 and less than 1");
  rules->Between("optimization.weight_concentration", "concentration",
                 optimization.weight_concentration(), 0.0, 1e3);
  rules->Require(optimization.weight_concentration() == 0.0 || optimization.mixture_epochs() > 0,
                 "optimization.weight_concentration",
                 "works only in the mixture phase: set optimization.mixture_epochs above 0");
  rules->Require(optimization.dropout() >= 0 && optimization.dropout() < 1, "optimization.dropout",
                 "must be at least 0 and less than 1");
  rules->Require(optimization.covered_share() >= 0 && optimization.covered_share() < 1,
                 "optimization.covered_share", "must be at least 0 and less than 1");
  // Batch normalisation needs two examples.
  rules->Between("optimization.batch_size", "examples", optimization.batch_size(), 2, 65'536);
  rules->Require(optimization.micro_batches() == 0 ||
                     (optimization.micro_batches() > 0 && optimization.micro_batches() <= 1024 &&
                      std::has_single_bit(static_cast<unsigned>(optimization.micro_batches()))),
                 "optimization.micro_batches", "must be 0 or a power of two up to 1024");
  rules->Between("optimization.learning_rate", "rate", optimization.learning_rate(), 1e-8, 1.0);
  rules->Between("optimization.latent_learning_rate_share", "share",
                 optimization.latent_learning_rate_share(), 1e-6, 10.0);
  const auto check_weight = [rules](const char* field, double weight) {
    rules->Between(field, "weight", weight, 0.0, 1e4);
  };
  rules->Between("optimization.weight_decay", "decay", optimization.weight_decay(), 0.0, 1.0);
  rules->Between("optimization.slow_speed", "metres per second", optimization.slow_speed(), 0.01,
                 100.0);
  check_weight("optimization.cluster_weight", optimization.cluster_weight());
  check_weight("optimization.action_weight", optimization.action_weight());
  check_weight("optimization.posterior_reconstruction_weight",
               optimization.posterior_reconstruction_weight());
  rules->Between("optimization.posterior_huber", "metres", optimization.posterior_huber(), 0.0,
                 1e3);
  rules->Between("optimization.posterior_actions", "actions", optimization.posterior_actions(), 0,
                 256);
  rules->Require(optimization.geometry_dropout() >= 0 && optimization.geometry_dropout() < 1,
                 "optimization.geometry_dropout", "must be at least 0 and less than 1");
  check_epochs("optimization.covariance_epochs", optimization.covariance_epochs(), 0);
  check_weight("optimization.posterior_divergence_weight",
               optimization.posterior_divergence_weight());
}

void CheckAugmentation(const v1::AugmentationSettings& augmentation, const v1::ModelSpec& model,
                       FieldRules* rules) {
  const v1::RasterSpec& raster = model.raster();
  rules->Between("augmentation.scale", "share", augmentation.scale(), 0.0, 0.5);
  rules->Between("augmentation.shift_pixels", "pixels", augmentation.shift_pixels(), 0,
                 std::max(0, std::min(raster.height(), raster.width()) / 4));
  rules->Between("augmentation.rotation", "radians", augmentation.rotation(), 0.0, 0.5);
  for (const auto& [field, share] :
       {std::pair("augmentation.drop_agents", augmentation.drop_agents()),
        {"augmentation.drop_history", augmentation.drop_history()}}) {
    rules->Require(share >= 0 && share < 1, field, "must be at least 0 and less than 1");
  }
  rules->Between("augmentation.sensor_noise", "share", augmentation.sensor_noise(), 0.0, 1.0);
  rules->Require(augmentation.sensor_noise() == 0.0 || model.has_scene_vectors(),
                 "augmentation.sensor_noise", "needs model.scene_vectors");
}

}  // namespace

v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings) {
  const std::string name =
      settings.preset().empty() ? DefaultPreset(settings.model()) : settings.preset();
  v1::TrainingSettings resolved;
  if (name == "compact") {
    resolved = ParsePreset({kLearning, kCompact});
  } else if (name == "lanes") {
    resolved = ParsePreset({kLearning, kLanes});
  } else if (name == "lanes-metres") {
    resolved = ParsePreset({kLearning, kLanes, kLanesMetres});
  } else if (name == "paper") {
    resolved = ParsePreset({kLearning, kPaper});
  } else if (name == "resnet50") {
    resolved = ParsePreset({kLearning, kPaper, kResNet50});
  } else if (name == "literal") {
    resolved = ParsePreset({kLearning, kCompact, kLiteral});
  } else {
    return settings;
  }
  Replace(settings, &resolved);
  if (resolved.optimization().decoder_covariance() == v1::DECODER_COVARIANCE_PREDICTED &&
      !resolved.model().has_decoder_covariance()) {
    resolved.mutable_model()->mutable_decoder_covariance()->add_hidden(kCovarianceWidth);
  }
  // A dual model learns q(z|y,s) in the posterior epochs alone, so it needs some.
  if (resolved.model().objective() == v1::OBJECTIVE_DUAL &&
      !settings.optimization().has_posterior_epochs() &&
      resolved.optimization().posterior_epochs() == 0) {
    resolved.mutable_optimization()->set_posterior_epochs(kDualPosteriorEpochs);
  }
  if (resolved.optimization().decoder_covariance() != v1::DECODER_COVARIANCE_SCENE &&
      !settings.model().has_scene_covariance()) {
    resolved.mutable_model()->clear_scene_covariance();
  }
  return resolved;
}

v1::TrainingSettings ResolveTrainingSettings(const v1::TrainingSettings& settings,
                                             const v1::ModelSpec& start) {
  v1::TrainingSettings resolved = settings;
  resolved.clear_model();
  if (start.has_decoder_covariance() &&
      resolved.optimization().decoder_covariance() == v1::DECODER_COVARIANCE_UNSPECIFIED) {
    resolved.mutable_optimization()->set_decoder_covariance(v1::DECODER_COVARIANCE_PREDICTED);
  }
  if (start.has_scene_covariance() &&
      resolved.optimization().decoder_covariance() == v1::DECODER_COVARIANCE_UNSPECIFIED) {
    resolved.mutable_optimization()->set_decoder_covariance(v1::DECODER_COVARIANCE_SCENE);
  }
  if (resolved.preset().empty()) resolved.set_preset(DefaultPreset(start));
  resolved = ResolveTrainingSettings(resolved);
  *resolved.mutable_model() = start;
  if (start.objective() == v1::OBJECTIVE_UNSPECIFIED) {
    resolved.mutable_model()->set_objective(v1::OBJECTIVE_UNIFIED);
  }
  if (settings.model().objective() != v1::OBJECTIVE_UNSPECIFIED) {
    resolved.mutable_model()->set_objective(settings.model().objective());
  }
  return resolved;
}

std::vector<scene::FieldViolation> ValidateStart(const v1::TrainingSettings& settings,
                                                 const v1::ModelSpec& start) {
  FieldRules rules;
  v1::TrainingSettings asked;
  *asked.mutable_model() = settings.model();
  asked.mutable_model()->clear_objective();
  v1::TrainingSettings started;
  *started.mutable_model() = start;
  Replace(asked, &started);
  std::string difference;
  google::protobuf::util::MessageDifferencer differencer;
  // An unset field equals a field that is 0.
  differencer.set_message_field_comparison(google::protobuf::util::MessageDifferencer::EQUIVALENT);
  differencer.ReportDifferencesToString(&difference);
  const bool agrees = differencer.Compare(start, started.model());
  absl::StripTrailingAsciiWhitespace(&difference);
  rules.Require(
      agrees, "model",
      absl::StrCat(
          "has other sizes than the version to start from, which fixes them; leave it out (",
          absl::StrReplaceAll(difference, {{"\n", "; "}}), ")"));
  rules.Require(
      settings.optimization().weight_concentration() == 0.0, "optimization.weight_concentration",
      "is for the mixture alone, which a run that starts from a version does not learn anew");
  rules.Require(
      settings.optimization().decoder_covariance() != v1::DECODER_COVARIANCE_PREDICTED ||
          start.has_decoder_covariance(),
      "optimization.decoder_covariance",
      "must not be DECODER_COVARIANCE_PREDICTED: the version to start from has no network for it");
  rules.Require(settings.optimization().decoder_covariance() != v1::DECODER_COVARIANCE_SCENE ||
                    start.has_scene_covariance(),
                "optimization.decoder_covariance",
                "must not be DECODER_COVARIANCE_SCENE: the version to start from has no network "
                "for it");
  return std::move(rules).violations();
}

std::vector<scene::FieldViolation> ValidateTrainingSettings(const v1::TrainingSettings& resolved) {
  FieldRules rules;
  // An unknown preset leaves all other fields unset, so only that is reported.
  if (!rules.Require(Presets().contains(resolved.preset()), "preset",
                     absl::StrCat("must be one of ", absl::StrJoin(Presets(), ", ")))) {
    return std::move(rules).violations();
  }
  rules.Include("model.", ValidateModelSpec(resolved.model()));
  rules.Require(
      !resolved.model().has_decoder_covariance() ||
          resolved.optimization().decoder_covariance() == v1::DECODER_COVARIANCE_PREDICTED,
      "model.decoder_covariance",
      "needs optimization.decoder_covariance DECODER_COVARIANCE_PREDICTED");
  rules.Require((resolved.optimization().decoder_covariance() == v1::DECODER_COVARIANCE_SCENE) ==
                    resolved.model().has_scene_covariance(),
                "model.scene_covariance",
                "and optimization.decoder_covariance DECODER_COVARIANCE_SCENE need each other");
  CheckExamples(resolved.examples(), &rules);
  CheckOptimization(resolved.optimization(), resolved.model().objective(), &rules);
  CheckAugmentation(resolved.augmentation(), resolved.model(), &rules);
  rules.Between("threads", "threads", resolved.threads(), 0, 1024);
  rules.Require(resolved.device() == "cpu" || resolved.device() == "cuda", "device",
                "must be \"cpu\" or \"cuda\"");
  return std::move(rules).violations();
}

}  // namespace maneuver::artifact
