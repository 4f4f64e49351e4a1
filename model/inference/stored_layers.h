// Makes layers from the tensors of a stored model (artifact/tensor.h).

#ifndef MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_
#define MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"

namespace maneuver::inference {

// Returns the layer with `<name>.weight` and `<name>.bias`.
DenseLayer StoredLayer(const artifact::TensorMap& weights, const std::string& name, bool bf16);

// Returns the layer with `<name>.weight` and no bias.
//   network: index of the network, if the tensor holds several, [networks, out, in]
DenseLayer StoredLayerWithoutBias(const artifact::TensorMap& weights, const std::string& name,
                                  int64_t network = 0);

// Returns the stack of layers `<name>.0`, `<name>.1` and so on.
//   network: index of the network, if the tensors hold several, [networks, out, in]
Mlp StoredMlp(const artifact::TensorMap& weights, const std::string& name, bool bf16,
              int64_t network = 0);

// Returns all `count` networks of tensors that hold several.
std::vector<Mlp> StoredMlps(const artifact::TensorMap& weights, const std::string& name,
                            int64_t count, bool bf16);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_STORED_LAYERS_H_
