#include "model/inference/packed_networks.h"

#include <utility>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/inference/stored_layers.h"

namespace maneuver::inference {
namespace {

using artifact::Tensor;
using artifact::TensorMap;
using RowMajorXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The projection reads its grid as [C, h, w] (tensor.h), the convolutions write [h, w, C]: its
// columns are put in their order once, here.
DenseLayer MakeProjection(const v1::ModelSpec& spec, const TensorMap& weights, bool bf16) {
  const artifact::GridSize grid = artifact::BackboneLayers(spec).back().output;
  const Tensor& weight = weights.at("backbone.projection.weight");
  const int64_t outputs = weight.shape[0];
  const int64_t cells = int64_t{grid.height} * grid.width;
  const int64_t inputs = cells * grid.channels;
  std::vector<float> reordered(weight.values.size());
  for (int64_t o = 0; o < outputs; ++o) {
    for (int64_t c = 0; c < grid.channels; ++c) {
      for (int64_t cell = 0; cell < cells; ++cell) {
        reordered[static_cast<size_t>(o * inputs + cell * grid.channels + c)] =
            weight.values[static_cast<size_t>(o * inputs + c * cells + cell)];
      }
    }
  }
  return DenseLayer(static_cast<int>(inputs), static_cast<int>(outputs), reordered.data(),
                    weights.at("backbone.projection.bias").values.data(), bf16);
}

// A tensor as doubles, its trailing dimensions made one.
Eigen::MatrixXd Matrix(const Tensor& tensor) {
  const Eigen::Index rows = tensor.shape[0];
  const Eigen::Index columns = static_cast<Eigen::Index>(tensor.values.size()) / rows;
  return Eigen::Map<const RowMajorXf>(tensor.values.data(), rows, columns).cast<double>();
}

Eigen::VectorXd Vector(const Tensor& tensor) {
  return Eigen::Map<const Eigen::VectorXf>(tensor.values.data(),
                                           static_cast<Eigen::Index>(tensor.values.size()))
      .cast<double>();
}

// The decoded means of p(z|y), metres, without a reference. [K, 2T]
TrajectorySet::Rows GenericMeans(const PackedNetworks& networks) {
  const RowMajorXf latents = networks.mixture.mean.cast<float>();
  RowMajorXf decoded(latents.rows(), networks.decoder.outputs());
  MlpScratch scratch;
  networks.decoder.Apply(latents.data(), static_cast<int>(latents.rows()), &scratch,
                         decoded.data());
  TrajectorySet::Rows metres(decoded.rows(), decoded.cols());
  for (Eigen::Index k = 0; k < metres.rows(); ++k) {
    metres.row(k) =
        decoded.row(k).cast<double>().cwiseProduct(networks.trajectory_stddev.transpose()) +
        networks.trajectory_mean.transpose();
  }
  return metres;
}

}  // namespace

PackedNetworks::PackedNetworks(const v1::ModelSpec& spec, const TensorMap& weights, bool bf16)
    : action_predictor(StoredMlp(weights, "action_predictor", bf16)),
      trajectory_encoder(StoredMlp(weights, "trajectory_encoder", false)),
      decoder(StoredMlp(weights, "decoder", false)),
      scenario_encoders(StoredMlps(weights, "scenario_encoder", spec.actions(), bf16)),
      mixture{Matrix(weights.at("mixture.mean")), Matrix(weights.at("mixture.log_variance")),
              Vector(weights.at("mixture.log_weight"))},
      trajectory_mean(Vector(weights.at("trajectory.mean"))),
      trajectory_stddev(Vector(weights.at("trajectory.stddev"))) {
  if (bf16 && artifact::HasReference(spec) && SigmaDecoder::Supported()) {
    sigma_decoder.emplace(weights);
  }
  if (spec.has_raster()) {
    backbone.emplace(spec, weights, bf16);
    projection = MakeProjection(spec, weights, bf16);
  }
  if (spec.has_scene_vectors()) scene.emplace(spec, weights, bf16);
  if (spec.has_action_geometry()) actions.emplace(spec, weights, GenericMeans(*this));
  if (spec.mean_residual()) mean_residual.emplace(spec, weights);
  if (spec.has_scene_covariance()) {
    scene_covariance.emplace(spec, weights, bf16);
  } else if (spec.has_decoder_covariance()) {
    covariance_network = StoredMlp(weights, "decoder_covariance", false);
  } else {
    const Tensor& table = weights.at("decoder.covariance");
    decoder_covariance =
        Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
            table.values.data(), static_cast<Eigen::Index>(table.values.size()) / 3, 3)
            .cast<double>();
  }
}

size_t PackedNetworks::bytes() const {
  size_t bytes = action_predictor.bytes() + trajectory_encoder.bytes() + decoder.bytes();
  if (sigma_decoder) bytes += sigma_decoder->bytes();
  if (backbone) bytes += backbone->bytes() + projection->bytes();
  if (scene) bytes += scene->bytes();
  if (actions) bytes += actions->bytes();
  if (mean_residual) bytes += mean_residual->bytes();
  for (const Mlp& encoder : scenario_encoders) bytes += encoder.bytes();
  if (scene_covariance) bytes += scene_covariance->bytes();
  if (covariance_network) bytes += covariance_network->bytes();
  return bytes;
}

}  // namespace maneuver::inference
