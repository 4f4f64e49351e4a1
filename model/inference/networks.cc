#include "model/inference/networks.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"

namespace maneuver::inference {
namespace {

using artifact::Tensor;
using artifact::TensorMap;
using RowMajorXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The layers `<name>.0`, `<name>.1`, ... With `networks` of them side by side, [networks, out, in],
// those of number `network`.
Mlp MakeMlp(const TensorMap& weights, const std::string& name, bool bf16, int64_t network = 0) {
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

std::vector<Mlp> MakeScenarioEncoders(const v1::ModelSpec& spec, const TensorMap& weights,
                                      bool bf16) {
  std::vector<Mlp> encoders;
  for (int64_t k = 0; k < spec.actions(); ++k) {
    encoders.push_back(MakeMlp(weights, "scenario_encoder", bf16, k));
  }
  return encoders;
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

}  // namespace

Networks::Networks(const v1::ModelSpec& spec, const TensorMap& weights, bool bf16)
    : backbone(spec, weights, bf16),
      projection(MakeProjection(spec, weights, bf16)),
      action_predictor(MakeMlp(weights, "action_predictor", bf16)),
      trajectory_encoder(MakeMlp(weights, "trajectory_encoder", false)),
      decoder(MakeMlp(weights, "decoder", false)),
      scenario_encoders(MakeScenarioEncoders(spec, weights, bf16)),
      mixture{Matrix(weights.at("mixture.mean")), Matrix(weights.at("mixture.log_variance")),
              Vector(weights.at("mixture.log_weight"))},
      trajectory_mean(Vector(weights.at("trajectory.mean"))),
      trajectory_stddev(Vector(weights.at("trajectory.stddev"))) {
  if (spec.has_decoder_covariance()) {
    covariance_network = MakeMlp(weights, "decoder_covariance", false);
    return;
  }
  const Tensor& table = weights.at("decoder.covariance");
  decoder_covariance =
      Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>>(
          table.values.data(), static_cast<Eigen::Index>(table.values.size()) / 3, 3)
          .cast<double>();
}

size_t Networks::bytes() const {
  size_t bytes = backbone.bytes() + projection.bytes() + action_predictor.bytes() +
                 trajectory_encoder.bytes() + decoder.bytes();
  for (const Mlp& encoder : scenario_encoders) bytes += encoder.bytes();
  if (covariance_network) bytes += covariance_network->bytes();
  return bytes;
}

}  // namespace maneuver::inference
