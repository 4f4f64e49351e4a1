#include "model/learning/networks.h"

#include <ATen/CPUGeneratorImpl.h>

#include <cmath>
#include <stdexcept>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/learning/kernels/batch_norm_relu.h"
#include "model/learning/kernels/raster_convolution.h"
#include "model/learning/trajectory_basis.h"

namespace maneuver::learning {
namespace {

constexpr double kSmall = 0.05;        // of the usual deviation: last layers that start small
constexpr double kKnotInterval = 0.8;  // seconds: what a driver does takes no less
// What hardly varies is not blown up, metres.
constexpr double kSmallestDeviation = 0.3;

bool StartsWith(const std::string& name, const std::string& prefix) {
  return name.compare(0, prefix.size(), prefix) == 0;
}

bool EndsWith(const std::string& name, const std::string& suffix) {
  return name.size() >= suffix.size() &&
         name.compare(name.size() - suffix.size(), suffix.size(), suffix) == 0;
}

// Inputs of each output of a weight: [out, in], [out, in, k, k] or [K, out, in].
int64_t FanIn(const std::string& name, const std::vector<int64_t>& shape) {
  if (StartsWith(name, "scenario_encoder.")) return shape[2];
  int64_t fan = 1;
  for (size_t i = 1; i < shape.size(); ++i) fan *= shape[i];
  return fan;
}

std::string Layer(const std::string& network, size_t i, const char* tensor) {
  return network + "." + std::to_string(i) + "." + tensor;
}

}  // namespace

at::Generator MakeGenerator(uint64_t seed) {
  return at::make_generator<at::CPUGeneratorImpl>(seed);
}

Networks::Networks(const v1::ModelSpec& spec, at::Device device, at::Generator& generator)
    : spec_(spec),
      device_(device),
      backbone_(artifact::BackboneLayers(spec)),
      last_decoder_layer_("decoder." + std::to_string(spec.decoder().hidden_size())) {
  Eigen::MatrixXf basis =
      SplineBasis(artifact::WaypointTimes(spec.trajectory()), kKnotInterval).transpose();
  const int64_t functions = basis.rows();
  basis_ = at::from_blob(basis.data(), {basis.cols(), functions}).clone().to(device);
  coefficient_stddev_ = at::ones({functions, 2}, basis_.options());

  const std::string last_scenario_layer = Layer(
      "scenario_encoder", static_cast<size_t>(spec.scenario_encoder().hidden_size()), "weight");
  const std::string last_action_layer = Layer(
      "action_predictor", static_cast<size_t>(spec.action_predictor().hidden_size()), "weight");
  for (auto [name, shape] : artifact::TensorShapes(spec)) {
    if (StartsWith(name, last_decoder_layer_)) shape[0] = 2 * functions;
    at::Tensor values = at::zeros(shape, at::kFloat);
    bool learned = true;
    if (EndsWith(name, "running_mean") || name == "decoder.covariance" ||
        name == "trajectory.mean") {
      learned = false;
    } else if (EndsWith(name, "running_var") || name == "trajectory.stddev") {
      values.fill_(1.0);
      learned = false;
    } else if (StartsWith(name, "backbone.") && shape.size() == 1 && EndsWith(name, ".weight")) {
      values.fill_(1.0);  // of a normalisation
    } else if (name == "mixture.log_weight") {
      values.fill_(-std::log(static_cast<double>(spec.actions())));
    } else if (EndsWith(name, ".weight")) {
      double stddev = std::sqrt(2.0 / static_cast<double>(FanIn(name, shape)));
      if (name == last_scenario_layer || name == last_action_layer) stddev *= kSmall;
      values.normal_(0.0, stddev, generator);
    }
    values = values.to(device_);
    if (values.dim() == 4) values = values.contiguous(at::MemoryFormat::ChannelsLast);
    values.set_requires_grad(learned);
    tensors_.emplace(name, values);
  }
  // A residual block begins as what it adds to (Goyal et al., Accurate, Large Minibatch SGD, 5.1).
  at::NoGradGuard no_grad;
  for (const artifact::BackboneLayer& layer : backbone_) {
    if (layer.adds) (*this)[layer.normalization + ".weight"].zero_();
  }
}

at::Tensor& Networks::operator[](const std::string& name) {
  const auto found = tensors_.find(name);
  TORCH_CHECK(found != tensors_.end(), "no tensor is called ", name);
  return found->second;
}

const at::Tensor& Networks::operator[](const std::string& name) const {
  const auto found = tensors_.find(name);
  TORCH_CHECK(found != tensors_.end(), "no tensor is called ", name);
  return found->second;
}

at::Tensor Networks::Mlp(const std::string& name, size_t layers, at::Tensor x) const {
  for (size_t i = 0; i < layers; ++i) {
    if (i > 0) x = x.relu();
    x = at::linear(x, (*this)[Layer(name, i, "weight")], (*this)[Layer(name, i, "bias")]);
  }
  return x;
}

at::Tensor Networks::EvaluateBackbone(const at::Tensor& rasters, bool training) {
  using Kind = artifact::BackboneLayer::Kind;
  at::Tensor grids[artifact::kBackboneRegisters];
  for (const artifact::BackboneLayer& layer : backbone_) {
    at::Tensor grid = grids[layer.source];
    const int64_t padding = layer.kernel / 2;
    switch (layer.kind) {
      case Kind::kConvolution: {
        const at::Tensor& weight = (*this)[layer.convolution + ".weight"];
        const bool first = &layer == &backbone_.front();
        grid = first ? ConvolveRasters(rasters, weight, layer.stride)
                     : at::conv2d(grid, weight, {}, layer.stride, padding);
        const BatchNorm norm = {(*this)[layer.normalization + ".weight"],
                                (*this)[layer.normalization + ".bias"],
                                (*this)[layer.normalization + ".running_mean"],
                                (*this)[layer.normalization + ".running_var"]};
        if (training && layer.relu && !layer.adds) {
          grids[layer.destination] = BatchNormRelu(grid, norm);
          continue;
        }
        grid = at::batch_norm(grid, norm.weight, norm.bias, norm.running_mean, norm.running_var,
                              training, kBatchNormMomentum, kBatchNormEpsilon,
                              /*cudnn_enabled=*/true);
        break;
      }
      case Kind::kMaxPool:
        grid = at::max_pool2d(grid, layer.kernel, layer.stride, padding);
        break;
      case Kind::kAveragePool:
        grid = grid.mean({2, 3}, /*keepdim=*/true);
        break;
    }
    if (layer.adds) grid = grid + grids[layer.destination];
    grids[layer.destination] = layer.relu ? grid.relu() : grid;
  }
  return grids[backbone_.back().destination];
}

at::Tensor Networks::EncodeScenes(const at::Tensor& rasters, const at::Tensor& motions,
                                  const Mode& mode) {
  const at::Tensor grid = EvaluateBackbone(rasters, mode.training != nullptr);
  at::Tensor features =
      at::linear(grid.contiguous().flatten(1), (*this)["backbone.projection.weight"],
                 (*this)["backbone.projection.bias"])
          .relu();
  if (mode.training != nullptr && mode.dropout > 0.0) {
    const at::Tensor kept = at::empty(features.sizes(), at::kFloat)
                                .bernoulli_(1.0 - mode.dropout, *mode.training)
                                .div_(1.0 - mode.dropout);
    features = features * kept.to(device_);
  }
  if (spec_.target_motion()) features = at::cat({features, motions.to(device_)}, 1);
  return features;
}

at::Tensor Networks::PredictActions(const at::Tensor& features) const {
  const size_t layers = static_cast<size_t>(spec_.action_predictor().hidden_size()) + 1;
  return at::log_softmax(Mlp("action_predictor", layers, features), 1);
}

Gaussian Networks::EncodeTrajectories(const at::Tensor& trajectories) const {
  const size_t layers = static_cast<size_t>(spec_.trajectory_encoder().hidden_size()) + 1;
  const at::Tensor standard = (trajectories - (*this)["trajectory.mean"].flatten()) /
                              (*this)["trajectory.stddev"].flatten();
  const std::vector<at::Tensor> halves = Mlp("trajectory_encoder", layers, standard).chunk(2, -1);
  return {halves[0], halves[1]};
}

at::Tensor Networks::Decode(const at::Tensor& latents) const {
  const size_t layers = static_cast<size_t>(spec_.decoder().hidden_size()) + 1;
  return at::linear(Mlp("decoder", layers, latents), CurveMap(),
                    (*this)["trajectory.mean"].flatten());
}

at::Tensor Networks::PredictCovariance(const at::Tensor& latents) const {
  const size_t layers = static_cast<size_t>(spec_.decoder_covariance().hidden_size()) + 1;
  const at::Tensor factors =
      Mlp("decoder_covariance", layers, latents).unflatten(-1, {basis_.size(0), 3});
  const auto stddev = [&](int64_t index) {
    return factors.select(-1, index)
        .clamp(artifact::kLeastLogStddev, artifact::kMostLogStddev)
        .exp();
  };
  const at::Tensor l11 = stddev(0);
  const at::Tensor l22 = stddev(1);
  const at::Tensor l21 = factors.select(-1, 2) * l22;
  return at::stack({l11.square(), l11 * l21, l21.square() + l22.square()}, -1);
}

at::Tensor Networks::CurveMap() const {
  // Position t, axis a is the sum over functions m of basis [t, m] times coefficient [m, a].
  const int64_t waypoints = basis_.size(0);
  const int64_t functions = basis_.size(1);
  at::Tensor map = at::zeros({waypoints, 2, functions, 2}, basis_.options());
  for (int axis = 0; axis < 2; ++axis) {
    map.select(1, axis).select(2, axis).copy_(basis_ * coefficient_stddev_.select(1, axis));
  }
  return map.view({2 * waypoints, 2 * functions});
}

void Networks::Standardize(const at::Tensor& trajectories, bool mirrored) {
  at::NoGradGuard no_grad;
  const at::Tensor points = trajectories.to(device_).view({trajectories.size(0), -1, 2});
  const auto moments = [&](const at::Tensor& values, at::Tensor* mean) {
    *mean = values.mean(0);
    if (mirrored) mean->select(1, 1).zero_();
    const at::Tensor square = values.square().mean(0);
    return (square - mean->square()).clamp_min(0.0).sqrt().clamp_min(kSmallestDeviation);
  };
  at::Tensor mean;
  (*this)["trajectory.stddev"].copy_(moments(points, &mean));
  // The mean is itself a curve of the basis, so that all that is decoded is.
  (*this)["trajectory.mean"].copy_(at::matmul(basis_, at::matmul(basis_.t(), mean)));
  at::Tensor coefficient_mean;
  coefficient_stddev_ = moments(at::matmul(basis_.t(), points), &coefficient_mean);
}

// The raw outputs a, b of the K scenario encoders, [K, B, 2D].
at::Tensor Networks::PerAction(const at::Tensor& features) const {
  const size_t layers = static_cast<size_t>(spec_.scenario_encoder().hidden_size()) + 1;
  const int64_t batch = features.size(0);
  const int64_t actions = spec_.actions();
  at::Tensor x;
  for (size_t i = 0; i < layers; ++i) {
    const at::Tensor& weight = (*this)[Layer("scenario_encoder", i, "weight")];  // [K, out, in]
    const at::Tensor& bias = (*this)[Layer("scenario_encoder", i, "bias")];      // [K, out]
    if (i == 0) {
      // All read the same features: one product for all of them.
      x = at::linear(features, weight.flatten(0, 1), bias.flatten())
              .view({batch, actions, weight.size(1)})
              .transpose(0, 1);
    } else {
      x = at::baddbmm(bias.unsqueeze(1), x.relu(), weight.transpose(1, 2));
    }
  }
  return x;
}

Gaussian Networks::EncodeScenarios(const at::Tensor& features) const {
  const std::vector<at::Tensor> halves = PerAction(features).transpose(0, 1).chunk(2, -1);
  const at::Tensor mean = (*this)["mixture.mean"].detach();
  const at::Tensor log_variance = (*this)["mixture.log_variance"].detach();
  return {mean + (0.5 * log_variance).exp() * halves[0], log_variance + halves[1]};
}

Gaussian Networks::Mixture() const {
  return {(*this)["mixture.mean"], (*this)["mixture.log_variance"]};
}

at::Tensor Networks::MixtureLogWeights() const {
  return at::log_softmax((*this)["mixture.log_weight"], 0);
}

std::vector<at::Tensor> Networks::Parameters(Part part) const {
  const auto prefix = [part]() -> std::string {
    switch (part) {
      case Part::kTrajectoryEncoder:
        return "trajectory_encoder.";
      case Part::kDecoder:
        return "decoder.";
      case Part::kMixture:
        return "mixture.";
      case Part::kBackbone:
        return "backbone.";
      case Part::kActions:
        return "action_predictor.";
      case Part::kScenarioEncoder:
        return "scenario_encoder.";
      case Part::kDecoderCovariance:
        return "decoder_covariance.";
    }
    return "";
  }();
  std::vector<at::Tensor> parameters;
  for (const auto& [name, tensor] : tensors_) {
    if (StartsWith(name, prefix) && tensor.requires_grad()) parameters.push_back(tensor);
  }
  return parameters;
}

Networks::Snapshot Networks::Save() const {
  Snapshot snapshot;
  for (const auto& [name, tensor] : tensors_) snapshot[name] = tensor.detach().clone();
  return snapshot;
}

void Networks::Restore(const Snapshot& snapshot) {
  at::NoGradGuard no_grad;
  for (auto& [name, tensor] : tensors_) tensor.copy_(snapshot.at(name));
}

void Networks::SilenceScenarioEncoders() {
  at::NoGradGuard no_grad;
  const std::string last =
      "scenario_encoder." + std::to_string(spec_.scenario_encoder().hidden_size());
  (*this)[last + ".weight"].zero_();
  (*this)[last + ".bias"].zero_();
}

void Networks::SwitchOff(std::span<const int> actions) {
  // Far below any logit that is learned; the softmax makes it 0, and with it its gradient.
  constexpr double kNever = -1e4;
  at::NoGradGuard no_grad;
  at::Tensor& bias = (*this)[Layer(
      "action_predictor", static_cast<size_t>(spec_.action_predictor().hidden_size()), "bias")];
  for (const int action : actions) {
    bias[action].fill_(kNever);
    (*this)["mixture.log_weight"][action].fill_(kNever);
  }
}

artifact::TensorMap Networks::Export() const {
  at::NoGradGuard no_grad;
  artifact::TensorMap weights;
  // The folder's decoder yields positions in deviations.
  const at::Tensor to_positions = CurveMap() / (*this)["trajectory.stddev"].flatten().unsqueeze(1);
  for (const auto& [name, tensor] : tensors_) {
    at::Tensor exported = tensor;
    if (name == "mixture.log_weight") exported = at::log_softmax(tensor, 0);
    if (StartsWith(name, last_decoder_layer_)) exported = at::matmul(to_positions, tensor);
    const at::Tensor values = exported.detach().to(at::kCPU).contiguous();
    artifact::Tensor& copy = weights[name];
    copy.shape = values.sizes().vec();
    copy.values.assign(values.data_ptr<float>(), values.data_ptr<float>() + values.numel());
  }
  return weights;
}

void Networks::Import(const artifact::TensorMap& weights) {
  at::NoGradGuard no_grad;
  const auto values = [&](const std::string& name) {
    const artifact::Tensor& stored = weights.at(name);
    return at::tensor(at::ArrayRef<float>(stored.values), at::kFloat)
        .view(stored.shape)
        .to(device_);
  };
  // Positions in deviations to coefficients: the basis is orthonormal.
  const at::Tensor stddev = values("trajectory.stddev").flatten().unsqueeze(1);
  const at::Tensor deviations = coefficient_stddev_.flatten().unsqueeze(1);
  const at::Tensor to_coefficients = (CurveMap() / deviations.t()).t() / deviations * stddev.t();
  for (auto& [name, tensor] : tensors_) {
    at::Tensor imported = values(name);
    if (StartsWith(name, last_decoder_layer_)) imported = at::matmul(to_coefficients, imported);
    tensor.copy_(imported);
  }
}

}  // namespace maneuver::learning
