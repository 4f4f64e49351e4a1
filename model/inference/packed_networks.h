// All networks of a model, packed for evaluation.

#ifndef MANEUVER_MODEL_INFERENCE_PACKED_NETWORKS_H_
#define MANEUVER_MODEL_INFERENCE_PACKED_NETWORKS_H_

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/inference/action_network.h"
#include "model/inference/backbone.h"
#include "model/inference/mean_residual.h"
#include "model/inference/mlp.h"
#include "model/inference/scene_covariance.h"
#include "model/inference/scene_network.h"
#include "model/inference/sigma_decoder.h"
#include "model/probability/latent_mixture.h"

namespace maneuver::inference {

// Immutable; safe to share between threads. Built from weights that fit the spec, as
// artifact::ReadModelFolder returns them.
struct PackedNetworks {
  // May throw oneDNN's exceptions, as Backbone does. With bf16, these weights are bf16: those of
  // the convolutions, and those of the wide layers that make and read a scene's features, which are
  // fetched from memory for every few targets. All layers whose output is metres stay in f32,
  // because means need the precision; only the differences of sigma points do not.
  PackedNetworks(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16);

  size_t bytes() const;

  // Only for a model with a raster.
  std::optional<Backbone> backbone;
  std::optional<DenseLayer> projection;  // last grid as [h, w, C] -> F
  // Only for a model with scene vectors.
  std::optional<SceneNetwork> scene;
  Mlp action_predictor;    // F' -> K logits of p(y|s)
  Mlp trajectory_encoder;  // 2T -> 2D: mean and log-variance of q(z|x)
  Mlp decoder;             // D -> 2T
  // Only in bf16 with a reference. Models in metres keep the bits of earlier releases.
  std::optional<SigmaDecoder> sigma_decoder;
  std::vector<Mlp> scenario_encoders;  // [K] F' -> 2D: a and b of q(z|y,s)
  probability::LatentMixture mixture;  // p(z|y)
  Eigen::VectorXd trajectory_mean;     // [2T] metres
  Eigen::VectorXd trajectory_stddev;   // [2T] metres
  // Only for actions that look at the lanes.
  std::optional<ActionNetwork> actions;
  // Only for a mean that depends on the scene.
  std::optional<MeanResidual> mean_residual;
  // The covariance of p(x|z), one of three: a function of the scene; a function of the latent, D ->
  // 3T as in tensor.h; or one for each action, [K * T, 3] xx, xy, yy, square metres.
  std::optional<SceneCovariance> scene_covariance;
  std::optional<Mlp> covariance_network;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> decoder_covariance;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_PACKED_NETWORKS_H_
