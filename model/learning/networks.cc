#include "model/learning/networks.h"

#include <ATen/CPUGeneratorImpl.h>

#include <cmath>
#include <stdexcept>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/learning/autograd/batch_norm_relu.h"
#include "model/learning/autograd/raster_convolution.h"
#include "model/learning/trajectory_basis.h"
#include "model/scene/lane_path_inputs.h"

namespace maneuver::learning {
namespace {

constexpr double kSmall = 0.05;        // of the usual deviation: last layers that start small
constexpr double kVectorsShare = 0.4;  // of the usual deviation: layers that read vectors
// Deviations are at least this, metres, so that nearly constant coordinates are not amplified.
constexpr double kSmallestDeviation = 0.3;

// Inputs of each output of a weight: [out, in], [out, in, k, k] or [K, out, in].
int64_t FanIn(const std::vector<int64_t>& shape) {
  if (shape.size() == 3) return shape[2];
  int64_t fan = 1;
  for (size_t i = 1; i < shape.size(); ++i) fan *= shape[i];
  return fan;
}

// Layers whose output is added to another one. They start at 0, as if they were absent.
bool StartsAtZero(const std::string& name) {
  return name.starts_with("action_geometry.logit.") ||
         name.starts_with("action_geometry.latent.") || name.starts_with("mean_residual.");
}

// Numbers `first` .. `last` of a set's elements.
struct InputRange {
  const char* layer;
  int64_t first;
  int64_t last;
};

// What a dataset may lack altogether: the speed limit, the signal and the stop sign of a lane path
// (lane_paths.h), what they make of a pair (action_geometry.h), and agents of other types than
// vehicles (agent_inputs.h). A weight of a number that is always 0 gets no gradient. Random ones
// would act on scenes that have the thing, and nothing would have been learned about it. (With
// versions 1 and 2 of the inputs, numbers 78 and 82 are 100 m where there is nothing. Their weights
// then learn as biases do, and act all the same.)
constexpr InputRange kMayBeMissing[] = {
    {"lane_path.0.weight", scene::LanePathRow::kSpeedLimit, scene::LanePathRow::kSpeedLimit},
    {"lane_path.0.weight", scene::LanePathRow::kSignal, scene::kLanePathInputs - 1},
    {"action_geometry.pair.weight", 16, 17},
    {"agent.0.weight", 17, 18}};

// Layers whose inputs are numbers of all kinds and whose outputs are summed.
bool ReadsVectors(const std::string& name) {
  for (const char* prefix : {"history.", "lane_path.", "agent.", "join.", "action_geometry."}) {
    if (name.starts_with(prefix)) return true;
  }
  return false;
}

bool IsResidualWeight(const std::string& name) {
  return name.starts_with("mean_residual.") && name.ends_with(".weight");
}

// The four functions of time that ln stddev of scene_covariance is a sum of (tensor.h). [T, 4]
at::Tensor StddevTerms(const std::vector<double>& waypoint_times) {
  const auto count = static_cast<int64_t>(waypoint_times.size());
  const at::Tensor t = at::tensor(at::ArrayRef<double>(waypoint_times), at::kDouble).to(at::kFloat);
  const at::Tensor relative = 2.0 * t / waypoint_times.back();
  return at::stack({at::ones({count}), relative.log(), relative - 1.0, (-t).exp()}, 1);
}

// values [B, K, in], weight [K, out, in] -> [B, K, out], each action by its own weight.
at::Tensor OfEachAction(const at::Tensor& values, const at::Tensor& weight) {
  return at::bmm(values.transpose(0, 1), weight.transpose(1, 2)).transpose(0, 1);
}

// Returns `values` clamped to least .. most. A value outside gets the gradients that lead back
// inside, which clamp() would drop: once too small, a deviation could never grow again.
at::Tensor ClampedFromWithin(const at::Tensor& values, double least, double most) {
  const at::Tensor clamped = values.clamp(least, most);
  if (!clamped.requires_grad()) return clamped;
  const at::Tensor outside = (clamped - values).detach();  // > 0 below the least value
  const at::Tensor result = values + outside;
  result.register_hook([outside](const at::Tensor& gradient) {
    return at::where(outside * gradient > 0, at::zeros_like(gradient), gradient);
  });
  return result;
}

std::string Layer(const std::string& network, int i, const char* tensor) {
  return network + "." + std::to_string(i) + "." + tensor;
}

}  // namespace

at::Generator MakeGenerator(uint64_t seed) {
  return at::make_generator<at::CPUGeneratorImpl>(seed);
}

Networks::Networks(const v1::ModelSpec& spec, at::Device device, at::Generator& generator)
    : spec_(spec),
      device_(device),
      backbone_(spec.has_raster() ? artifact::BackboneLayers(spec)
                                  : std::vector<artifact::BackboneLayer>()),
      last_decoder_layer_(artifact::LastLayer("decoder", spec.decoder())),
      geometry_waypoints_(
          scene::FindGeometryWaypoints(artifact::WaypointTimes(spec.trajectory()))) {
  Eigen::MatrixXf basis =
      SplineBasis(artifact::WaypointTimes(spec.trajectory()), artifact::kKnotInterval).transpose();
  const int64_t functions = basis.rows();
  basis_ = at::from_blob(basis.data(), {basis.cols(), functions}).clone().to(device);
  coefficient_stddev_ = at::ones({functions, 2}, basis_.options());

  stddev_terms_ = StddevTerms(artifact::WaypointTimes(spec.trajectory())).to(device);
  TORCH_CHECK(functions == artifact::CurveFunctions(spec.trajectory()), "CurveFunctions is off");
  const std::string last_scenario_layer =
      artifact::LastLayer("scenario_encoder", spec.scenario_encoder()) + ".weight";
  const std::string last_action_layer =
      artifact::LastLayer("action_predictor", spec.action_predictor()) + ".weight";
  const std::string last_covariance_layer =
      artifact::LastLayer("scene_covariance", spec.scene_covariance());
  for (auto [name, shape] : artifact::TensorShapes(spec)) {
    if (name.starts_with(last_decoder_layer_)) shape[0] = 2 * functions;
    at::Tensor values = at::zeros(shape, at::kFloat);
    bool learned = true;
    if (name.ends_with("running_mean") || name == "decoder.covariance" ||
        name == "trajectory.mean") {
      learned = false;
    } else if (name.ends_with("running_var") || name == "trajectory.stddev") {
      values.fill_(1.0);
      learned = false;
    } else if (name == "mean_residual.curves") {
      learned = false;  // filled in when it is exported
    } else if (name == "scene_covariance.speed_factor") {
      values.fill_(1.0);
      learned = false;
    } else if (name == last_covariance_layer + ".bias") {
      // Along and across: spreads that grow with the time.
      values.copy_(at::tensor({0.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0}, at::kFloat));
    } else if (StartsAtZero(name)) {
      values.zero_();
    } else if (name.starts_with("backbone.") && shape.size() == 1 && name.ends_with(".weight")) {
      values.fill_(1.0);  // of a normalisation
    } else if (name == "mixture.log_weight") {
      values.fill_(-std::log(static_cast<double>(spec.actions())));
    } else if (name.ends_with(".weight")) {
      double stddev = std::sqrt(2.0 / static_cast<double>(FanIn(shape)));
      if (name == last_scenario_layer || name == last_action_layer ||
          name == last_covariance_layer + ".weight") {
        stddev *= kSmall;
      }
      if (ReadsVectors(name)) stddev *= kVectorsShare;
      values.normal_(0.0, stddev, generator);
    }
    for (const InputRange& range : kMayBeMissing) {
      if (name == range.layer) values.slice(1, range.first, range.last + 1).zero_();
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

at::Tensor Networks::Mlp(const std::string& name, const v1::MlpSpec& mlp, at::Tensor x) const {
  for (int i = 0; i <= mlp.hidden_size(); ++i) {
    if (i > 0) x = x.relu();
    x = at::linear(x, (*this)[Layer(name, i, "weight")], (*this)[Layer(name, i, "bias")]);
  }
  return x;
}

at::Tensor Networks::EvaluateBackbone(const RasterBatch& rasters, bool training) {
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
        grid = training ? BatchNormOfBatch(grid, norm)
                        : at::batch_norm(grid, norm.weight, norm.bias, norm.running_mean,
                                         norm.running_var, /*training=*/false, kBatchNormMomentum,
                                         kBatchNormEpsilon, /*cudnn_enabled=*/true);
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

at::Tensor Networks::PredictActions(const SceneFeatures& scenes) const {
  at::Tensor logits = Mlp("action_predictor", spec_.action_predictor(), scenes.features);
  if (scenes.geometry.defined()) {
    logits =
        logits + at::linear(scenes.geometry, (*this)["action_geometry.logit.weight"]).squeeze(2);
  }
  return at::log_softmax(logits, 1);
}

Gaussian Networks::EncodeTrajectories(const at::Tensor& trajectories) const {
  const at::Tensor standard = (trajectories - (*this)["trajectory.mean"].flatten()) /
                              (*this)["trajectory.stddev"].flatten();
  const std::vector<at::Tensor> halves =
      Mlp("trajectory_encoder", spec_.trajectory_encoder(), standard).chunk(2, -1);
  return {halves[0], halves[1]};
}

at::Tensor Networks::Decode(const at::Tensor& latents, const at::Tensor& residual) const {
  at::Tensor coefficients = Mlp("decoder", spec_.decoder(), latents);
  if (residual.defined()) coefficients = coefficients + residual;
  return at::linear(coefficients, CurveMap(), (*this)["trajectory.mean"].flatten());
}

at::Tensor Networks::MeanResidual(const SceneFeatures& scenes) const {
  if (!spec_.mean_residual()) return {};
  const at::Tensor& weight = (*this)["mean_residual.scene.weight"];  // [K, 2M, F]
  at::Tensor residual = at::linear(scenes.features, weight.flatten(0, 1))
                            .unflatten(1, {weight.size(0), weight.size(1)});
  if (!scenes.geometry.defined()) return residual;
  return residual + OfEachAction(scenes.geometry, (*this)["mean_residual.geometry.weight"]);
}

at::Tensor Networks::PredictLogStddevs(const SceneFeatures& scenes) const {
  const at::Tensor numbers =
      PerAction("scene_covariance", spec_.scene_covariance(), scenes.features)
          .transpose(0, 1)
          .unflatten(2, {2, artifact::kStddevTerms});  // [B, K, 2, 4]
  return ClampedFromWithin(at::matmul(numbers, stddev_terms_.t()).transpose(2, 3),
                           artifact::kLeastLogStddev, artifact::kMostLogStddev);
}

at::Tensor Networks::PredictCovariance(const at::Tensor& latents) const {
  const at::Tensor factors = Mlp("decoder_covariance", spec_.decoder_covariance(), latents)
                                 .unflatten(-1, {basis_.size(0), 3});
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

at::Tensor Networks::PerAction(const std::string& name, const v1::MlpSpec& mlp,
                               const at::Tensor& features) const {
  const int64_t batch = features.size(0);
  const int64_t actions = spec_.actions();
  at::Tensor x;
  for (int i = 0; i <= mlp.hidden_size(); ++i) {
    const at::Tensor& weight = (*this)[Layer(name, i, "weight")];  // [K, out, in]
    const at::Tensor& bias = (*this)[Layer(name, i, "bias")];      // [K, out]
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

Gaussian Networks::EncodeScenarios(const SceneFeatures& scenes) const {
  at::Tensor outputs = PerAction("scenario_encoder", spec_.scenario_encoder(), scenes.features)
                           .transpose(0, 1);  // [B, K, 2D]
  if (scenes.geometry.defined()) {
    outputs = outputs + OfEachAction(scenes.geometry, (*this)["action_geometry.latent.weight"]);
  }
  const std::vector<at::Tensor> halves = outputs.chunk(2, -1);
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

std::vector<std::string> Networks::NamesOf(Part part) const {
  // By the beginnings of their names; the longest that fits decides.
  static const auto& parts =
      *new std::map<std::string, Part>{{"trajectory_encoder.", Part::kTrajectoryEncoder},
                                       {"decoder.", Part::kDecoder},
                                       {"mixture.", Part::kMixture},
                                       {"backbone.", Part::kScene},
                                       {"history.", Part::kScene},
                                       {"lane_path.", Part::kScene},
                                       {"agent.", Part::kScene},
                                       {"join.", Part::kScene},
                                       {"action_geometry.", Part::kScene},
                                       {"action_geometry.latent.", Part::kScenarioEncoder},
                                       {"action_geometry.logit.", Part::kActions},
                                       {"action_predictor.", Part::kActions},
                                       {"scenario_encoder.", Part::kScenarioEncoder},
                                       {"mean_residual.", Part::kScenarioEncoder},
                                       {"decoder_covariance.", Part::kDecoderCovariance},
                                       {"scene_covariance.", Part::kSceneCovariance}};
  std::vector<std::string> names;
  for (const auto& [name, tensor] : tensors_) {
    if (!tensor.requires_grad()) continue;
    size_t longest = 0;
    bool belongs = false;
    for (const auto& [prefix, of] : parts) {
      if (!name.starts_with(prefix) || prefix.size() < longest) continue;
      longest = prefix.size();
      belongs = of == part;
    }
    if (belongs) names.push_back(name);
  }
  return names;
}

std::vector<at::Tensor> Networks::Parameters(Part part) const {
  std::vector<at::Tensor> parameters;
  for (const std::string& name : NamesOf(part)) parameters.push_back((*this)[name]);
  return parameters;
}

std::vector<bool> Networks::Decays(Part part) const {
  std::vector<bool> decays;
  for (const std::string& name : NamesOf(part)) {
    decays.push_back(name.ends_with(".weight") && (*this)[name].dim() > 1);
  }
  return decays;
}

std::vector<at::Tensor> Networks::RunningMoments() const {
  std::vector<at::Tensor> moments;
  for (const auto& [name, tensor] : tensors_) {
    if (name.ends_with("running_mean") || name.ends_with("running_var")) moments.push_back(tensor);
  }
  return moments;
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

void Networks::ZeroScenarioEncoders() {
  at::NoGradGuard no_grad;
  const std::string last = artifact::LastLayer("scenario_encoder", spec_.scenario_encoder()) + ".";
  for (auto& [name, tensor] : tensors_) {
    if (name.starts_with(last) || name.starts_with("action_geometry.latent.") ||
        IsResidualWeight(name)) {
      tensor.zero_();
    }
  }
}

void Networks::SwitchOff(std::span<const int> actions) {
  // Far below any logit that is learned; the softmax makes it 0, and with it its gradient.
  constexpr double kNever = -1e4;
  at::NoGradGuard no_grad;
  at::Tensor& bias =
      (*this)[artifact::LastLayer("action_predictor", spec_.action_predictor()) + ".bias"];
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
    if (name.starts_with(last_decoder_layer_)) exported = at::matmul(to_positions, tensor);
    if (name == "mean_residual.curves") exported = CurveMap();
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
    if (name.starts_with(last_decoder_layer_)) imported = at::matmul(to_coefficients, imported);
    if (IsResidualWeight(name)) {
      // From the coefficients of the stored curves, in metres, to ours in standard deviations.
      imported = at::matmul((CurveMap() / deviations.t()).t() / deviations,
                            at::matmul(values("mean_residual.curves"), imported));
    }
    tensor.copy_(imported);
  }
}

}  // namespace maneuver::learning
