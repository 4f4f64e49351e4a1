#include "model/artifact/model_cost.h"

#include <cstdint>
#include <string>

#include "absl/strings/match.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/tensor.h"
#include "model/scene/action_geometry.h"
#include "model/scene/agent_inputs.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/target_history.h"

namespace maneuver::artifact {
namespace {

constexpr auto kFloatBytes = static_cast<int64_t>(sizeof(float));

// Returns whether a tensor is learned by gradients. The others are measured.
bool IsLearned(const std::string& name) {
  return !absl::EndsWith(name, ".running_mean") && !absl::EndsWith(name, ".running_var") &&
         !absl::StartsWith(name, "trajectory.") && name != "decoder.covariance" &&
         name != "mean_residual.curves" && name != "scene_covariance.speed_factor";
}

int64_t MultiplyAdds(const BackboneLayer& layer) {
  if (layer.kind != BackboneLayer::Kind::kConvolution) return 0;
  return layer.output.values() * layer.input.channels * layer.kernel * layer.kernel;
}

int64_t MultiplyAdds(int64_t inputs, const v1::MlpSpec& mlp, int64_t outputs) {
  int64_t sum = 0;
  for (const int32_t width : mlp.hidden()) {
    sum += inputs * width;
    inputs = width;
  }
  return sum + inputs * outputs;
}

int64_t OfBackbone(const v1::ModelSpec& spec) {
  if (!spec.has_raster()) return 0;
  int64_t sum = 0;
  int64_t flattened = 0;
  for (const BackboneLayer& layer : BackboneLayers(spec)) {
    sum += MultiplyAdds(layer);
    flattened = layer.output.values();
  }
  return sum + flattened * spec.backbone().features();
}

// Returns the cost of lane_path.* or agent.* (tensor.h) for a set of `elements`, each with
// `numbers`.
int64_t OfSet(int64_t elements, int64_t numbers, int64_t width, int64_t heads, int64_t history) {
  return history * width + elements * width * (numbers + width + width + heads + 1);
}

// Returns the cost of history.*, lane_path.*, agent.* and join.* (tensor.h).
int64_t OfSceneVectors(const v1::ModelSpec& spec) {
  if (!spec.has_scene_vectors()) return 0;
  const v1::SceneVectorsSpec& vectors = spec.scene_vectors();
  const int64_t H = vectors.history_width();
  const int64_t P = vectors.path_width();
  const int64_t Q = vectors.agent_width();
  const int64_t raster = spec.has_raster() ? spec.backbone().features() : 0;
  return H * (scene::kHistoryInputs + H) +
         OfSet(scene::kMostLanePaths, scene::kLanePathInputs, P, vectors.attention_heads(), H) +
         OfSet(scene::kMostNearAgents, scene::kAgentInputs, Q, vectors.agent_heads(), H) +
         (H + 2 * P + 2 * Q + raster) * vectors.features();
}

// Returns the cost of action_geometry.* for all actions. What a layer adds for the scene or for a
// path is shared by all actions.
int64_t OfActionGeometry(const v1::ModelSpec& spec) {
  if (!spec.has_action_geometry()) return 0;
  const v1::ActionGeometrySpec& geometry = spec.action_geometry();
  const int64_t F = SceneFeatureCount(spec);
  const int64_t P = spec.scene_vectors().path_width();
  const int64_t G = geometry.pair_width();
  const int64_t A = geometry.features();
  const int64_t shared = F * G + scene::kMostLanePaths * P * G + F * A;
  const int64_t pair = scene::kPairNumbers * G + G * G + G * geometry.attention_heads() + G;
  const int64_t action = (2 * G + scene::kActionNumbers) * A + A * A + A;
  return shared + spec.actions() * (scene::kMostLanePaths * pair + action);
}

// Returns the cost, per action, of mean_residual.* and of what h_y adds to the latent.
int64_t OfMeanResidual(const v1::ModelSpec& spec) {
  const int64_t A = spec.action_geometry().features();
  const int64_t latent = A * 2 * spec.latent_dimensions();
  if (!spec.mean_residual()) return latent;
  const int64_t curves = 2 * CurveFunctions(spec.trajectory());
  return latent + (SceneFeatureCount(spec) + A + 2 * spec.trajectory().waypoints()) * curves;
}

int64_t OfCovariance(const v1::ModelSpec& spec) {
  if (spec.has_scene_covariance()) {
    return MultiplyAdds(SceneFeatureCount(spec), spec.scene_covariance(), 2 * kStddevTerms);
  }
  if (!spec.has_decoder_covariance()) return 0;
  return MultiplyAdds(spec.latent_dimensions(), spec.decoder_covariance(),
                      3 * spec.trajectory().waypoints());
}

}  // namespace

v1::ModelCost CountCost(const v1::ModelSpec& spec) {
  v1::ModelCost cost;
  int64_t backbone_parameters = 0;
  int64_t parameters = 0;
  for (const auto& [name, shape] : TensorShapes(spec)) {
    if (!IsLearned(name)) continue;
    int64_t count = 1;
    for (const int64_t size : shape) count *= size;
    parameters += count;
    if (absl::StartsWith(name, "backbone.")) backbone_parameters += count;
  }
  cost.set_backbone_parameters(backbone_parameters);
  cost.set_parameters(parameters);

  const int64_t F = SceneFeatureCount(spec);
  const int64_t D = spec.latent_dimensions();
  const int64_t sigma_points = 2 * D + 1;
  cost.set_backbone_multiply_adds(OfBackbone(spec));
  cost.set_vector_multiply_adds(OfSceneVectors(spec));
  cost.set_predictor_multiply_adds(MultiplyAdds(F, spec.action_predictor(), spec.actions()) +
                                   OfActionGeometry(spec));
  cost.set_distribution_multiply_adds(
      MultiplyAdds(F, spec.scenario_encoder(), 2 * D) +
      sigma_points * MultiplyAdds(D, spec.decoder(), 2 * spec.trajectory().waypoints()) +
      OfMeanResidual(spec) + OfCovariance(spec));
  return cost;
}

int64_t PredictionBytes(const v1::ModelSpec& spec) {
  const int64_t of_waypoint = spec.has_scene_covariance() ? 11 : 5;  // mean and covariances
  const int64_t waypoints = spec.trajectory().waypoints();
  const int64_t of_action = of_waypoint * waypoints + spec.latent_dimensions() + 2;
  return kFloatBytes * (spec.actions() * of_action + 2 * waypoints + 1);
}

int64_t ExampleBytes(const v1::ModelSpec& spec) {
  // A layer keeps its output, the input of its activation, and the gradients of both.
  constexpr int64_t kCopies = 4;
  // Batches that wait to be learned from. A raster waits as its nonzero values: about a twelfth of
  // all, of 8 bytes each. This counts a byte for each value.
  constexpr int64_t kBatchesAhead = 4;
  const auto widths = [](const v1::MlpSpec& mlp) {
    int64_t sum = 0;
    for (const int32_t width : mlp.hidden()) sum += width;
    return sum;
  };
  int64_t raster = 0;
  int64_t values = SceneFeatureCount(spec) + widths(spec.action_predictor());
  if (spec.has_raster()) {
    raster = RasterGrid(spec.raster()).values();
    values += raster;
    for (const BackboneLayer& layer : BackboneLayers(spec)) values += layer.output.values();
  }
  if (spec.has_scene_vectors()) {
    const v1::SceneVectorsSpec& vectors = spec.scene_vectors();
    values += 3 * (scene::kMostLanePaths * vectors.path_width() +
                   scene::kMostNearAgents * vectors.agent_width());
  }
  int64_t of_action = widths(spec.decoder()) + widths(spec.scenario_encoder()) +
                      6 * spec.latent_dimensions() + 4 * spec.trajectory().waypoints();
  if (spec.has_action_geometry()) {
    of_action +=
        scene::kMostLanePaths * (2 * spec.action_geometry().pair_width() + scene::kPairNumbers) +
        3 * spec.action_geometry().features();
  }
  return kFloatBytes * kCopies * (values + spec.actions() * of_action) + kBatchesAhead * raster;
}

}  // namespace maneuver::artifact
