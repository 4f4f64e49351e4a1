#include "model/inference/folded_convolution.h"

#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"

namespace maneuver::inference {
namespace {

constexpr double kNormalizationEpsilon = 1e-5;  // tensor.h

}  // namespace

FoldedConvolution Fold(const artifact::TensorMap& weights, const artifact::BackboneLayer& layer,
                       double input_scale) {
  const auto part = [&](const char* name) -> const std::vector<float>& {
    return weights.at(absl::StrCat(layer.normalization, ".", name)).values;
  };
  FoldedConvolution folded;
  folded.weight = weights.at(layer.convolution + ".weight").values;
  const size_t outputs = part("weight").size();
  const size_t taps = folded.weight.size() / outputs;
  for (size_t c = 0; c < outputs; ++c) {
    const double scale =
        part("weight")[c] / std::sqrt(double{part("running_var")[c]} + kNormalizationEpsilon);
    for (size_t i = 0; i < taps; ++i) {
      float& weight = folded.weight[c * taps + i];
      weight = static_cast<float>(weight * scale * input_scale);
    }
    folded.bias.push_back(
        static_cast<float>(part("bias")[c] - double{part("running_mean")[c]} * scale));
  }
  return folded;
}

}  // namespace maneuver::inference
