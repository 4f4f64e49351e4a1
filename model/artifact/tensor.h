#ifndef MANEUVER_MODEL_ARTIFACT_TENSOR_H_
#define MANEUVER_MODEL_ARTIFACT_TENSOR_H_

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace maneuver::artifact {

// A dense row-major array of 32-bit floats.
struct Tensor {
  std::vector<int64_t> shape;
  std::vector<float> values;  // product of shape
};

// Tensors by name. The names of a model's weights and their shapes, PyTorch's conventions
// throughout (C_in, h, w: of the layer's input; flattening is channel-major, [C, h, w]):
//
//   backbone.convolution.{i}.weight   [C_out, C_in, 3, 3]   no bias: batch normalisation follows
//   backbone.normalization.{i}.{weight,bias,running_mean,running_var}   [C_out], epsilon 1e-5
//   of a residual backbone in their place, each convolution.weight with such a normalization:
//     backbone.stem.convolution, backbone.stage.{s}.block.{b}.convolution.{i} and, where a block's
//     input is not of its output's size, backbone.stage.{s}.block.{b}.shortcut.convolution
//   backbone.projection.{weight,bias}   [F, C * h * w], [F]   on the flattened last grid; then ReLU
//   action_predictor.{i}.{weight,bias}   [out, in], [out]   F' -> hidden ... -> K logits; F' is F
//       features, then the target's motion if the spec has it (scene/target_motion.h)
//   trajectory_encoder.{i}.{weight,bias}   2T -> hidden ... -> 2D: mean, then log-variance
//   decoder.{i}.{weight,bias}   D -> hidden ... -> 2T
//   scenario_encoder.{i}.{weight,bias}   [K, out, in], [K, out]   F' -> hidden ... -> 2D: a, then
//   b;
//       q(z|y=k,s) has mean mu_k + sigma_k * a and log-variance logvar_k + b (relative to the
//       component k of the mixture, so that an untrained encoder answers the generic action)
//   mixture.mean, mixture.log_variance   [K, D]
//   mixture.log_weight   [K]   ln p(y) without a scenario, normalised
//   trajectory.mean, trajectory.stddev   [T, 2]   metres: the encoder reads (x - mean) / stddev,
//       the decoder's output times stddev plus mean is metres
//   decoder.covariance   [K, T, 3]   xx, xy, yy, square metres, target frame: what p(x|z) adds to
//       the latent covariance of action k at each waypoint, in moments
//   or in its place, if the spec has it, a function of the mean of the latent:
//   decoder_covariance.{i}.{weight,bias}   D -> hidden ... -> 3T: a, b, c of each waypoint, whose
//       covariance is L L^T with L = (e^a 0; c e^b e^b), a and b held within the bounds below
//
// A trajectory [T, 2] is flattened as x_1, y_1, x_2, y_2, ...
using TensorMap = std::map<std::string, Tensor>;

// Bounds of a and b of decoder_covariance: 5 cm and 55 m.
inline constexpr float kLeastLogStddev = -3.0f;
inline constexpr float kMostLogStddev = 4.0f;

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_TENSOR_H_
