// Layers from the tensors of a stored model (artifact/tensor.h).

#ifndef MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_
#define MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"

namespace maneuver::inference {

// `<name>.weight` and `<name>.bias`.
DenseLayer StoredLayer(const artifact::TensorMap& weights, const std::string& name, bool bf16);

// `<name>.weight`, without a bias. With several layers side by side, [networks, out, in], number
// `network`.
DenseLayer StoredLayerWithoutBias(const artifact::TensorMap& weights, const std::string& name,
                                  int64_t network = 0);

// `<name>.0`, `<name>.1`, ... With several networks side by side, [networks, out, in], number
// `network`.
Mlp StoredMlp(const artifact::TensorMap& weights, const std::string& name, bool bf16,
              int64_t network = 0);

// All `count` networks that lie side by side.
std::vector<Mlp> StoredMlps(const artifact::TensorMap& weights, const std::string& name,
                            int64_t count, bool bf16);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_
