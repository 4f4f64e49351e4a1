#include "model/inference/stored_layers.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::inference {

using artifact::Tensor;
using artifact::TensorMap;

DenseLayer StoredLayer(const TensorMap& weights, const std::string& name, bool bf16) {
  const Tensor& weight = weights.at(absl::StrCat(name, ".weight"));
  return DenseLayer(static_cast<int>(weight.shape[1]), static_cast<int>(weight.shape[0]),
                    weight.values.data(), weights.at(absl::StrCat(name, ".bias")).values.data(),
                    bf16);
}

DenseLayer StoredLayerWithoutBias(const TensorMap& weights, const std::string& name,
                                  int64_t network) {
  const Tensor& weight = weights.at(absl::StrCat(name, ".weight"));
  const int64_t inputs = weight.shape.back();
  const int64_t outputs = weight.shape[weight.shape.size() - 2];
  const std::vector<float> zeros(static_cast<size_t>(outputs));
  return DenseLayer(static_cast<int>(inputs), static_cast<int>(outputs),
                    weight.values.data() + network * inputs * outputs, zeros.data());
}

Mlp StoredMlp(const TensorMap& weights, const std::string& name, bool bf16, int64_t network) {
  std::vector<DenseLayer> layers;
  for (int i = 0;; ++i) {
    const auto found = weights.find(absl::StrCat(name, ".", i, ".weight"));
    if (found == weights.end()) return Mlp(std::move(layers));
    const Tensor& weight = found->second;
    const Tensor& bias = weights.at(absl::StrCat(name, ".", i, ".bias"));
    const int64_t inputs = weight.shape.back();
    const int64_t outputs = bias.shape.back();
    layers.emplace_back(static_cast<int>(inputs), static_cast<int>(outputs),
                        weight.values.data() + network * inputs * outputs,
                        bias.values.data() + network * outputs, bf16);
  }
}

std::vector<Mlp> StoredMlps(const TensorMap& weights, const std::string& name, int64_t count,
                            bool bf16) {
  std::vector<Mlp> networks;
  for (int64_t k = 0; k < count; ++k) networks.push_back(StoredMlp(weights, name, bf16, k));
  return networks;
}

}  // namespace maneuver::inference
