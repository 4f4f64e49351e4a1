#include "model/artifact/model_cost.h"

#include <cstdint>
#include <string>

#include "absl/strings/match.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"

namespace maneuver::artifact {
namespace {

// Whether gradients change a tensor; the others are measured.
bool IsLearned(const std::string& name) {
  return !absl::EndsWith(name, ".running_mean") && !absl::EndsWith(name, ".running_var") &&
         !absl::StartsWith(name, "trajectory.") && name != "decoder.covariance";
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

  int64_t backbone = 0;
  int64_t flattened = 0;
  for (const BackboneLayer& layer : BackboneLayers(spec)) {
    backbone += MultiplyAdds(layer);
    flattened = layer.output.values();
  }
  cost.set_backbone_multiply_adds(backbone + flattened * spec.backbone().features());
  cost.set_predictor_multiply_adds(
      MultiplyAdds(SceneFeatures(spec), spec.action_predictor(), spec.actions()));
  const int64_t D = spec.latent_dimensions();
  const int64_t sigma_points = 2 * D + 1;
  const int64_t covariance =
      spec.has_decoder_covariance()
          ? MultiplyAdds(D, spec.decoder_covariance(), 3 * spec.trajectory().waypoints())
          : 0;
  cost.set_distribution_multiply_adds(
      covariance + MultiplyAdds(SceneFeatures(spec), spec.scenario_encoder(), 2 * D) +
      sigma_points * MultiplyAdds(D, spec.decoder(), 2 * spec.trajectory().waypoints()));
  return cost;
}

}  // namespace maneuver::artifact
