// Folds batch normalisation into the weights of a convolution.

#ifndef MANEUVER_MODEL_INFERENCE_FOLDED_CONVOLUTION_H_
#define MANEUVER_MODEL_INFERENCE_FOLDED_CONVOLUTION_H_

#include <vector>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/tensor.h"

namespace maneuver::inference {

// A convolution's weights and bias that include its batch normalisation, gamma (w x - m) / sqrt(v +
// eps) + beta.
struct FoldedConvolution {
  std::vector<float> weight;  // [C_out, C_in, k, k]
  std::vector<float> bias;    // [C_out]
};

// Folds one layer.
//   input_scale: factor by which the layer's input is multiplied first
FoldedConvolution Fold(const artifact::TensorMap& weights, const artifact::BackboneLayer& layer,
                       double input_scale);

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_FOLDED_CONVOLUTION_H_
