#include "model/artifact/model_spec.h"

#include <google/protobuf/duration.pb.h>
#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/field_rules.h"
#include "model/artifact/tensor.h"
#include "model/scene/action_geometry.h"
#include "model/scene/agent_inputs.h"
#include "model/scene/duration.h"
#include "model/scene/inputs_version.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/target_history.h"
#include "model/scene/target_motion.h"

namespace maneuver::artifact {
namespace {

constexpr int kMaxConvolutions = 8;
constexpr int kMaxChannels = 1024;
constexpr int kMaxKernel = 11;
constexpr int kMaxStages = 8;
constexpr int kMaxBlocks = 64;
constexpr int kMaxHiddenLayers = 8;
constexpr int kMaxHiddenWidth = 4096;
constexpr double kMaxHorizon = 60.0;               // seconds
constexpr double kMaxHistory = 10.0;               // seconds
constexpr int64_t kMaxWeights = int64_t{1} << 28;  // 1 GiB of 32-bit floats
constexpr int64_t kMaxGrid = int64_t{1} << 25;     // values of one layer and example

void CheckMlp(const v1::MlpSpec& mlp, const std::string& field, FieldRules* rules) {
  rules->Between(absl::StrCat(field, ".hidden"), "number of layers", mlp.hidden_size(), 1,
                 kMaxHiddenLayers);
  for (int i = 0; i < mlp.hidden_size(); ++i) {
    rules->Between(absl::StrCat(field, ".hidden[", i, "]"), "width", mlp.hidden(i), 1,
                   kMaxHiddenWidth);
  }
}

void CheckRaster(const v1::RasterSpec& raster, FieldRules* rules) {
  rules->Between("raster.height", "pixels", raster.height(), 16, 512);
  rules->Between("raster.width", "pixels", raster.width(), 16, 512);
  rules->Between("raster.meters_per_pixel", "metres", raster.meters_per_pixel(), 0.01, 10.0);
  rules->Require(raster.target_position() > 0 && raster.target_position() < 1,
                 "raster.target_position", "must lie strictly between 0 and 1");
  const bool counted =
      rules->Between("raster.history_frames", "frames", raster.history_frames(), 1, 50);
  if (rules->Positive("raster.frame_interval", raster.frame_interval()) && counted) {
    const double history =
        (raster.history_frames() - 1) * scene::ToSeconds(raster.frame_interval());
    rules->Require(history <= kMaxHistory, "raster.frame_interval",
                   absl::StrCat("makes a history of ", history, " s; at most ", kMaxHistory));
  }
}

void CheckConvolutions(const v1::BackboneSpec& backbone, FieldRules* rules) {
  rules->Between("backbone.convolutions", "number of layers", backbone.convolutions_size(), 1,
                 kMaxConvolutions);
  for (int i = 0; i < backbone.convolutions_size(); ++i) {
    const std::string field = absl::StrCat("backbone.convolutions[", i, "]");
    rules->Between(field + ".channels", "channels", backbone.convolutions(i).channels(), 1,
                   kMaxChannels);
    rules->Between(field + ".stride", "stride", backbone.convolutions(i).stride(), 1, 2);
  }
}

void CheckResidual(const v1::ResidualSpec& residual, FieldRules* rules) {
  const v1::StemSpec& stem = residual.stem();
  rules->Between("backbone.residual.stem.channels", "channels", stem.channels(), 1, kMaxChannels);
  rules->Require(
      stem.kernel_size() % 2 == 1 && stem.kernel_size() >= 1 && stem.kernel_size() <= kMaxKernel,
      "backbone.residual.stem.kernel_size",
      absl::StrCat("must be odd and 1 to ", kMaxKernel, ", not ", stem.kernel_size()));
  rules->Between("backbone.residual.stem.stride", "stride", stem.stride(), 1, 2);
  rules->Require(residual.block() == v1::RESIDUAL_BLOCK_BASIC ||
                     residual.block() == v1::RESIDUAL_BLOCK_BOTTLENECK,
                 "backbone.residual.block", "must be basic or bottleneck");
  rules->Between("backbone.residual.stages", "number of stages", residual.stages_size(), 1,
                 kMaxStages);
  for (int i = 0; i < residual.stages_size(); ++i) {
    const std::string field = absl::StrCat("backbone.residual.stages[", i, "]");
    rules->Between(field + ".blocks", "blocks", residual.stages(i).blocks(), 1, kMaxBlocks);
    rules->Between(field + ".width", "channels", residual.stages(i).width(), 1, kMaxChannels);
    rules->Between(field + ".stride", "stride", residual.stages(i).stride(), 1, 2);
  }
}

void CheckBackbone(const v1::BackboneSpec& backbone, FieldRules* rules) {
  if (!backbone.has_residual()) {
    CheckConvolutions(backbone, rules);
  } else if (rules->Require(backbone.convolutions().empty(), "backbone.residual",
                            "is in place of backbone.convolutions, not beside them")) {
    CheckResidual(backbone.residual(), rules);
  }
  rules->Between("backbone.features", "width", backbone.features(), 1, kMaxHiddenWidth);
}

void CheckTrajectory(const v1::TrajectorySpec& trajectory, FieldRules* rules) {
  rules->Between("trajectory.waypoints", "waypoints", trajectory.waypoints(), 1, 200);
  if (rules->Positive("trajectory.waypoint_interval", trajectory.waypoint_interval())) {
    const double horizon =
        trajectory.waypoints() * scene::ToSeconds(trajectory.waypoint_interval());
    rules->Require(horizon <= kMaxHorizon, "trajectory.waypoint_interval",
                   absl::StrCat("makes a horizon of ", horizon, " s; at most ", kMaxHorizon));
  }
}

void CheckDivides(const std::string& field, int heads, const char* of, int width,
                  FieldRules* rules) {
  rules->Require(heads >= 1 && width % std::max(heads, 1) == 0, field,
                 absl::StrCat("must be at least 1 and divide ", of, " (", width, "), not ", heads));
}

void CheckSceneVectors(const v1::SceneVectorsSpec& vectors, FieldRules* rules) {
  rules->Between("scene_vectors.history_width", "width", vectors.history_width(), 1,
                 kMaxHiddenWidth);
  rules->Between("scene_vectors.features", "width", vectors.features(), 1, kMaxHiddenWidth);
  rules->Between("scene_vectors.path_width", "width", vectors.path_width(), 0, kMaxHiddenWidth);
  if (vectors.path_width() > 0) {
    CheckDivides("scene_vectors.attention_heads", vectors.attention_heads(), "path_width",
                 vectors.path_width(), rules);
  }
  rules->Between("scene_vectors.agent_width", "width", vectors.agent_width(), 0, kMaxHiddenWidth);
  if (vectors.agent_width() > 0) {
    CheckDivides("scene_vectors.agent_heads", vectors.agent_heads(), "agent_width",
                 vectors.agent_width(), rules);
  }
}

void CheckActionGeometry(const v1::ModelSpec& spec, FieldRules* rules) {
  const v1::ActionGeometrySpec& geometry = spec.action_geometry();
  rules->Require(ReadsLanePaths(spec), "action_geometry",
                 "needs lane paths: set scene_vectors.path_width, or leave action_geometry out "
                 "(in training settings: set action_geometry.pair_width to 0)");
  rules->Between("action_geometry.pair_width", "width", geometry.pair_width(), 1, kMaxHiddenWidth);
  rules->Between("action_geometry.features", "width", geometry.features(), 1, kMaxHiddenWidth);
  CheckDivides("action_geometry.attention_heads", geometry.attention_heads(), "pair_width",
               geometry.pair_width(), rules);
}

// Checks the inputs, and the parts that only some inputs allow.
void CheckInputs(const v1::ModelSpec& spec, FieldRules* rules) {
  rules->Require(spec.has_raster() || spec.has_scene_vectors(), "raster",
                 "must be set, or scene_vectors: the networks have to read something");
  if (spec.has_raster()) {
    CheckRaster(spec.raster(), rules);
    CheckBackbone(spec.backbone(), rules);
  } else {
    rules->Require(!spec.has_backbone(), "backbone", "needs a raster");
  }
  if (spec.has_scene_vectors()) {
    CheckSceneVectors(spec.scene_vectors(), rules);
    rules->Require(!spec.target_motion(), "target_motion",
                   "is part of scene_vectors; leave it out");
  }
  if (spec.has_action_geometry()) CheckActionGeometry(spec, rules);
  const auto needs_vectors = [&](bool asked, const char* field) {
    rules->Require(!asked || spec.has_scene_vectors(), field, "needs scene_vectors");
  };
  needs_vectors(HasReference(spec), "reference");
  needs_vectors(spec.mean_residual(), "mean_residual");
  needs_vectors(spec.has_scene_covariance(), "scene_covariance");
  rules->Require(!spec.has_scene_covariance() || !spec.has_decoder_covariance(), "scene_covariance",
                 "is in place of decoder_covariance, not beside it");
}

void CheckTargetTypes(const v1::ModelSpec& spec, FieldRules* rules) {
  std::set<int> seen;
  for (int i = 0; i < spec.target_types_size(); ++i) {
    const v1::AgentType type = spec.target_types(i);
    const std::string field = absl::StrCat("target_types[", i, "]");
    rules->Require(v1::AgentType_IsValid(type) && type != v1::AGENT_TYPE_UNSPECIFIED, field,
                   "is not a type of agents");
    rules->Require(seen.insert(type).second, field, "is named twice");
  }
}

struct TypeNames {
  const char* one;
  const char* several;
};

TypeNames NamesOf(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_VEHICLE:
      return {"a vehicle", "vehicles"};
    case v1::AGENT_TYPE_PEDESTRIAN:
      return {"a pedestrian", "pedestrians"};
    case v1::AGENT_TYPE_CYCLIST:
      return {"a cyclist", "cyclists"};
    case v1::AGENT_TYPE_OTHER:
      return {"an agent of another type", "agents of other types"};
    default:
      return {"an agent whose type is not stated", "agents whose type is not stated"};
  }
}

// Checks the memory of a spec whose fields are valid by themselves.
void CheckMemory(const v1::ModelSpec& spec, FieldRules* rules) {
  int64_t largest = 0;
  if (spec.has_raster()) {
    largest = RasterGrid(spec.raster()).values();
    for (const BackboneLayer& layer : BackboneLayers(spec)) {
      largest = std::max(largest, layer.output.values());
    }
  }
  rules->Require(largest <= kMaxGrid,
                 spec.backbone().has_residual() ? "backbone.residual" : "backbone.convolutions",
                 absl::StrCat("the largest grid has ", largest, " values; at most ", kMaxGrid));
  int64_t weights = 0;
  std::map<std::string, int64_t> of_parts;  // by the first part of the tensors' names
  for (const auto& [name, shape] : TensorShapes(spec)) {
    int64_t count = 1;
    for (const int64_t size : shape) count *= size;
    weights += count;
    of_parts[name.substr(0, name.find('.'))] += count;
  }
  const auto largest_part =
      std::ranges::max_element(of_parts, {}, [](const auto& part) { return part.second; });
  rules->Require(weights <= kMaxWeights, largest_part->first,
                 absl::StrCat("the model has ", weights, " weights, ", largest_part->second,
                              " of them here; at most ", kMaxWeights,
                              ": choose fewer actions or narrower layers"));
}

using Shapes = std::map<std::string, std::vector<int64_t>>;

// Adds the layers of an MLP. `prefix` is the leading dimension of K parallel networks, or empty.
void AddMlp(const std::string& name, int64_t inputs, const v1::MlpSpec& mlp, int64_t outputs,
            const std::vector<int64_t>& prefix, Shapes* shapes) {
  for (int i = 0; i <= mlp.hidden_size(); ++i) {
    const int64_t width = i < mlp.hidden_size() ? mlp.hidden(i) : outputs;
    std::vector<int64_t> weight = prefix;
    weight.insert(weight.end(), {width, inputs});
    std::vector<int64_t> bias = prefix;
    bias.push_back(width);
    shapes->emplace(absl::StrCat(name, ".", i, ".weight"), std::move(weight));
    shapes->emplace(absl::StrCat(name, ".", i, ".bias"), std::move(bias));
    inputs = width;
  }
}

// Returns the time of waypoint `number`, from 1, seconds. Computed from whole nanoseconds, so that
// 3 times 0.1 s is 0.3 s.
double TimeOfWaypoint(const v1::TrajectorySpec& spec, int64_t number) {
  const int64_t interval =
      google::protobuf::util::TimeUtil::DurationToNanoseconds(spec.waypoint_interval());
  return static_cast<double>(number * interval) / 1e9;
}

}  // namespace

std::vector<scene::FieldViolation> ValidateModelSpec(const v1::ModelSpec& spec) {
  FieldRules rules;
  CheckInputs(spec, &rules);
  CheckTrajectory(spec.trajectory(), &rules);
  CheckTargetTypes(spec, &rules);
  rules.Between("actions", "actions", spec.actions(), 2, 256);
  rules.Between("latent_dimensions", "dimensions", spec.latent_dimensions(), 1, 32);
  CheckMlp(spec.action_predictor(), "action_predictor", &rules);
  CheckMlp(spec.trajectory_encoder(), "trajectory_encoder", &rules);
  CheckMlp(spec.decoder(), "decoder", &rules);
  CheckMlp(spec.scenario_encoder(), "scenario_encoder", &rules);
  if (spec.has_decoder_covariance()) {
    CheckMlp(spec.decoder_covariance(), "decoder_covariance", &rules);
  }
  if (spec.has_scene_covariance()) CheckMlp(spec.scene_covariance(), "scene_covariance", &rules);
  constexpr char kUnknown[] = "is not one that this version knows";
  rules.Require(v1::TrajectoryReference_IsValid(spec.reference()), "reference", kUnknown);
  rules.Require(v1::Objective_IsValid(spec.objective()), "objective", kUnknown);
  rules.Require(spec.inputs_version() >= 0 && spec.inputs_version() <= scene::kLatestInputsVersion,
                "inputs_version", kUnknown);
  rules.Between("decoder_stddev", "metres", spec.decoder_stddev(), 1e-3, 100.0);
  if (rules.all_hold()) CheckMemory(spec, &rules);
  return std::move(rules).violations();
}

double WaypointInterval(const v1::TrajectorySpec& spec) { return TimeOfWaypoint(spec, 1); }

std::vector<double> WaypointTimes(const v1::TrajectorySpec& spec) {
  std::vector<double> times(static_cast<size_t>(spec.waypoints()));
  for (size_t t = 0; t < times.size(); ++t) {
    times[t] = TimeOfWaypoint(spec, static_cast<int64_t>(t + 1));
  }
  return times;
}

int64_t SceneFeatureCount(const v1::ModelSpec& spec) {
  if (spec.has_scene_vectors()) return spec.scene_vectors().features();
  return spec.backbone().features() + (spec.target_motion() ? scene::kMotionInputs : 0);
}

bool Predicts(const v1::ModelSpec& spec, v1::AgentType type) {
  if (type == v1::AGENT_TYPE_UNSPECIFIED) return true;
  if (spec.target_types().empty()) return type == v1::AGENT_TYPE_VEHICLE;
  return std::find(spec.target_types().begin(), spec.target_types().end(), type) !=
         spec.target_types().end();
}

std::string TargetTypesText(const v1::ModelSpec& spec) {
  if (spec.target_types().empty()) return NamesOf(v1::AGENT_TYPE_VEHICLE).several;
  std::string text;
  for (int i = 0; i < spec.target_types_size(); ++i) {
    if (i > 0) text += i + 1 < spec.target_types_size() ? ", " : " and ";
    text += NamesOf(spec.target_types(i)).several;
  }
  return text;
}

std::string AgentText(v1::AgentType type) { return NamesOf(type).one; }

bool HasReference(const v1::ModelSpec& spec) {
  return spec.reference() == v1::TRAJECTORY_REFERENCE_CONSTANT_VELOCITY ||
         spec.reference() == v1::TRAJECTORY_REFERENCE_FADING_MOTION;
}

bool ReadsLanePaths(const v1::ModelSpec& spec) { return spec.scene_vectors().path_width() > 0; }

bool ReadsAgents(const v1::ModelSpec& spec) { return spec.scene_vectors().agent_width() > 0; }

int64_t CurveFunctions(const v1::TrajectorySpec& spec) {
  constexpr int64_t kDegree = 3;
  const double horizon = spec.waypoints() * scene::ToSeconds(spec.waypoint_interval());
  const int64_t intervals = std::max<int64_t>(1, std::lround(horizon / kKnotInterval));
  return std::min<int64_t>(intervals + kDegree - 1, spec.waypoints());
}

namespace {

void AddDense(const std::string& name, int64_t inputs, int64_t outputs, Shapes* shapes) {
  shapes->emplace(name + ".weight", std::vector<int64_t>{outputs, inputs});
  shapes->emplace(name + ".bias", std::vector<int64_t>{outputs});
}

void AddBackbone(const v1::ModelSpec& spec, Shapes* shapes) {
  const std::vector<BackboneLayer> layers = BackboneLayers(spec);
  for (const BackboneLayer& layer : layers) {
    if (layer.kind != BackboneLayer::Kind::kConvolution) continue;
    const int64_t outputs = layer.output.channels;
    (*shapes)[layer.convolution + ".weight"] = {outputs, layer.input.channels, layer.kernel,
                                                layer.kernel};
    for (const char* part : {"weight", "bias", "running_mean", "running_var"}) {
      (*shapes)[absl::StrCat(layer.normalization, ".", part)] = {outputs};
    }
  }
  AddDense("backbone.projection", layers.back().output.values(), spec.backbone().features(),
           shapes);
}

// Adds the tensors of a set whose elements have `inputs` numbers each.
//   history: H
void AddSet(const std::string& name, int64_t inputs, int64_t history, int64_t width, int64_t heads,
            Shapes* shapes) {
  AddDense(name + ".0", inputs, width, shapes);
  AddDense(name + ".1", width, width, shapes);
  AddDense(name + ".history", history, width, shapes);
  AddDense(name + ".output", width, width, shapes);
  AddDense(name + ".attention", width, heads, shapes);
}

void AddSceneVectors(const v1::ModelSpec& spec, Shapes* shapes) {
  const v1::SceneVectorsSpec& vectors = spec.scene_vectors();
  const int64_t H = vectors.history_width();
  const int64_t P = vectors.path_width();
  const int64_t Q = vectors.agent_width();
  AddDense("history.0", scene::kHistoryInputs, H, shapes);
  AddDense("history.1", H, H, shapes);
  if (P > 0) AddSet("lane_path", scene::kLanePathInputs, H, P, vectors.attention_heads(), shapes);
  if (Q > 0) AddSet("agent", scene::kAgentInputs, H, Q, vectors.agent_heads(), shapes);
  const int64_t raster = spec.has_raster() ? spec.backbone().features() : 0;
  AddDense("join", H + 2 * P + 2 * Q + raster, vectors.features(), shapes);
}

void AddActionGeometry(const v1::ModelSpec& spec, Shapes* shapes) {
  const v1::ActionGeometrySpec& geometry = spec.action_geometry();
  const int64_t K = spec.actions();
  const int64_t F = SceneFeatureCount(spec);
  const int64_t P = spec.scene_vectors().path_width();
  const int64_t G = geometry.pair_width();
  const int64_t A = geometry.features();
  Shapes& all = *shapes;
  all["action_geometry.pair.weight"] = {G, scene::kPairNumbers};
  all["action_geometry.path.weight"] = {G, P};
  all["action_geometry.scene.weight"] = {G, F};
  all["action_geometry.action.bias"] = {K, G};
  AddDense("action_geometry.hidden", G, G, shapes);
  AddDense("action_geometry.attention", G, geometry.attention_heads(), shapes);
  all["action_geometry.joint.weight"] = {A, 2 * G + scene::kActionNumbers};
  all["action_geometry.joint_scene.weight"] = {A, F};
  all["action_geometry.joint_action.bias"] = {K, A};
  AddDense("action_geometry.output", A, A, shapes);
  all["action_geometry.logit.weight"] = {1, A};
  all["action_geometry.latent.weight"] = {K, 2 * int64_t{spec.latent_dimensions()}, A};
}

void AddMeanResidual(const v1::ModelSpec& spec, Shapes* shapes) {
  const int64_t K = spec.actions();
  const int64_t M = CurveFunctions(spec.trajectory());
  (*shapes)["mean_residual.scene.weight"] = {K, 2 * M, SceneFeatureCount(spec)};
  if (spec.has_action_geometry()) {
    (*shapes)["mean_residual.geometry.weight"] = {K, 2 * M, spec.action_geometry().features()};
  }
  (*shapes)["mean_residual.curves"] = {2 * int64_t{spec.trajectory().waypoints()}, 2 * M};
}

}  // namespace

std::string LastLayer(const std::string& network, const v1::MlpSpec& mlp) {
  return absl::StrCat(network, ".", mlp.hidden_size());
}

std::map<std::string, std::vector<int64_t>> TensorShapes(const v1::ModelSpec& spec) {
  const int64_t K = spec.actions();
  const int64_t D = spec.latent_dimensions();
  const int64_t T = spec.trajectory().waypoints();
  const int64_t features = SceneFeatureCount(spec);

  Shapes shapes;
  if (spec.has_raster()) AddBackbone(spec, &shapes);
  if (spec.has_scene_vectors()) AddSceneVectors(spec, &shapes);
  if (spec.has_action_geometry()) AddActionGeometry(spec, &shapes);
  if (spec.mean_residual()) AddMeanResidual(spec, &shapes);

  AddMlp("action_predictor", features, spec.action_predictor(), K, {}, &shapes);
  AddMlp("trajectory_encoder", 2 * T, spec.trajectory_encoder(), 2 * D, {}, &shapes);
  AddMlp("decoder", D, spec.decoder(), 2 * T, {}, &shapes);
  AddMlp("scenario_encoder", features, spec.scenario_encoder(), 2 * D, {K}, &shapes);

  shapes["mixture.mean"] = {K, D};
  shapes["mixture.log_variance"] = {K, D};
  shapes["mixture.log_weight"] = {K};
  shapes["trajectory.mean"] = {T, 2};
  shapes["trajectory.stddev"] = {T, 2};
  if (spec.has_scene_covariance()) {
    AddMlp("scene_covariance", features, spec.scene_covariance(), 2 * kStddevTerms, {K}, &shapes);
    shapes["scene_covariance.speed_factor"] = {kSpeedBinCount, 2};
  } else if (spec.has_decoder_covariance()) {
    AddMlp("decoder_covariance", D, spec.decoder_covariance(), 3 * T, {}, &shapes);
  } else {
    shapes["decoder.covariance"] = {K, T, 3};
  }
  return shapes;
}

}  // namespace maneuver::artifact
