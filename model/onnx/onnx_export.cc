#include "model/onnx/onnx_export.h"

#include <cmath>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/onnx/graph_builder.h"
#include "model/scene/target_motion.h"

namespace maneuver::onnx {
namespace {

using artifact::BackboneLayer;
using artifact::Tensor;
using Kind = BackboneLayer::Kind;

constexpr int64_t kFormat = 7;
constexpr int64_t kOperators = 13;
constexpr float kNormalizationEpsilon = 1e-5f;  // tensor.h
constexpr int64_t kAnyNumber = -1;

class Exporter {
 public:
  Exporter(const artifact::StoredModel& model, int scenes, GraphProto* graph)
      : model_(model),
        spec_(model.manifest.spec()),
        scenes_(scenes > 0 ? scenes : kAnyNumber),
        graph_(graph) {}

  void AddEverything(bool distributions) {
    const std::string features = AddFeatures();
    const std::string logits =
        AddMlp("action_predictor", spec_.action_predictor().hidden_size() + 1, features);
    graph_.Add("Softmax", "probabilities", {logits}, {Setting::One("axis", 1)});
    graph_.Output("features", {scenes_, artifact::SceneFeatures(spec_)});
    graph_.Output("probabilities", {scenes_, spec_.actions()});
    if (distributions) AddDistributions(features);
  }

 private:
  const Tensor& Weights(const std::string& name) const { return model_.weights.at(name); }

  std::string AddWeights(const std::string& name) {
    const Tensor& tensor = Weights(name);
    return graph_.Floats(name, tensor.shape, tensor.values);
  }

  std::string AddConvolution(const BackboneLayer& layer, const std::string& source,
                             const std::string& shortcut) {
    const int64_t kernel = layer.kernel, pad = kernel / 2, stride = layer.stride;
    std::string grid = graph_.Add(
        "Conv", layer.convolution, {source, AddWeights(layer.convolution + ".weight")},
        {Setting::List("kernel_shape", {kernel, kernel}),
         Setting::List("strides", {stride, stride}), Setting::List("pads", {pad, pad, pad, pad})});
    std::vector<std::string> inputs = {grid};
    for (const char* part : {".weight", ".bias", ".running_mean", ".running_var"}) {
      inputs.push_back(AddWeights(layer.normalization + part));
    }
    grid = graph_.Add("BatchNormalization", layer.normalization, inputs,
                      {Setting::Real("epsilon", kNormalizationEpsilon)});
    if (layer.adds) grid = graph_.Add("Add", layer.normalization + ".sum", {grid, shortcut});
    if (layer.relu) grid = graph_.Add("Relu", layer.normalization + ".relu", {grid});
    return grid;
  }

  // [N, F'].
  std::string AddFeatures() {
    const artifact::GridSize raster = artifact::RasterGrid(spec_.raster());
    graph_.Input("raster", {scenes_, raster.channels, raster.height, raster.width});
    std::string registers[artifact::kBackboneRegisters] = {"raster"};
    const std::vector<BackboneLayer> layers = artifact::BackboneLayers(spec_);
    int last = 0;
    for (const BackboneLayer& layer : layers) {
      const std::string& source = registers[layer.source];
      std::string grid;
      if (layer.kind == Kind::kConvolution) {
        grid = AddConvolution(layer, source, registers[layer.destination]);
      } else if (layer.kind == Kind::kMaxPool) {
        const int64_t kernel = layer.kernel, pad = kernel / 2, stride = layer.stride;
        grid = graph_.Add("MaxPool", absl::StrCat(source, ".maximum"), {source},
                          {Setting::List("kernel_shape", {kernel, kernel}),
                           Setting::List("strides", {stride, stride}),
                           Setting::List("pads", {pad, pad, pad, pad})});
      } else {
        grid = graph_.Add("GlobalAveragePool", absl::StrCat(source, ".average"), {source});
      }
      registers[layer.destination] = grid;
      last = layer.destination;
    }
    const std::string flat = graph_.Add("Flatten", "flat", {registers[last]});
    const std::string projected = AddDense("backbone.projection", flat, nullptr);
    if (!spec_.target_motion()) return graph_.Add("Relu", "features", {projected});
    graph_.Input("motion", {scenes_, scene::kMotionInputs});
    return graph_.Add("Concat", "features",
                      {graph_.Add("Relu", "projected", {projected}), "motion"},
                      {Setting::One("axis", 1)});
  }

  // y = W x + b. Of weights [networks, out, in] side by side, those of number `network`.
  std::string AddDense(const std::string& name, const std::string& input, const int64_t* network) {
    const Tensor& weight = Weights(name + ".weight");
    const Tensor& bias = Weights(name + ".bias");
    const int64_t inputs = weight.shape.back();
    const int64_t outputs = bias.shape.back();
    const int64_t number = network == nullptr ? 0 : *network;
    const std::string full = network == nullptr ? name : absl::StrCat(name, ".action.", number);
    const auto part = [&](const Tensor& tensor, int64_t size) {
      return std::span(tensor.values)
          .subspan(static_cast<size_t>(number * size), static_cast<size_t>(size));
    };
    return graph_.Add(
        "Gemm", full,
        {input, graph_.Floats(full + ".weight", {outputs, inputs}, part(weight, outputs * inputs)),
         graph_.Floats(full + ".bias", {outputs}, part(bias, outputs))},
        {Setting::One("transB", 1)});
  }

  // `<name>.0`, `<name>.1`, ... with ReLU between them.
  std::string AddMlp(const std::string& name, int layers, std::string x,
                     const int64_t* network = nullptr) {
    for (int i = 0; i < layers; ++i) {
      x = AddDense(absl::StrCat(name, ".", i), x, network);
      if (i + 1 < layers) x = graph_.Add("Relu", x + ".relu", {x});
    }
    return x;
  }

  std::string Reshape(const std::string& name, const std::string& x,
                      const std::vector<int64_t>& sizes) {
    return graph_.Add("Reshape", name, {x, graph_.Integers(name + ".shape", sizes)});
  }

  // One half of the K scenario encoders' outputs side by side, a (first = 0) or b: [N, K D].
  std::string AddHalf(const std::string& name, const std::vector<std::string>& outputs,
                      int64_t first) {
    const int64_t begin[] = {first}, end[] = {first + spec_.latent_dimensions()}, axis[] = {1};
    const std::string from = graph_.Integers(name + ".begin", begin);
    const std::string to = graph_.Integers(name + ".end", end);
    const std::string along = graph_.Integers(name + ".axis", axis);
    std::vector<std::string> halves;
    for (size_t k = 0; k < outputs.size(); ++k) {
      halves.push_back(
          graph_.Add("Slice", absl::StrCat(name, ".", k), {outputs[k], from, to, along}));
    }
    return graph_.Add("Concat", name, halves, {Setting::One("axis", 1)});
  }

  // x * scale + offset, both [columns of x].
  std::string AddScaled(const std::string& name, const std::string& x, std::span<const float> scale,
                        std::span<const float> offset) {
    const Sizes sizes = {static_cast<int64_t>(scale.size())};
    const std::string scaled =
        graph_.Add("Mul", name + ".scaled", {x, graph_.Floats(name + ".scale", sizes, scale)});
    return graph_.Add("Add", name, {scaled, graph_.Floats(name + ".offset", sizes, offset)});
  }

  // q(z|y,s) of all actions, mean and deviation, [N, K D] each; relative to the components of the
  // mixture (tensor.h).
  std::pair<std::string, std::string> AddPosteriors(const std::string& features) {
    std::vector<std::string> outputs;
    for (int64_t k = 0; k < spec_.actions(); ++k) {
      outputs.push_back(
          AddMlp("scenario_encoder", spec_.scenario_encoder().hidden_size() + 1, features, &k));
    }
    std::vector<float> stddev, log_stddev;
    for (const float log_variance : Weights("mixture.log_variance").values) {
      stddev.push_back(static_cast<float>(std::exp(0.5 * double{log_variance})));
      log_stddev.push_back(0.5f * log_variance);
    }
    const std::vector<float> half(stddev.size(), 0.5f);
    const std::string mean =
        AddScaled("posterior_mean", AddHalf("scenario_encoder.mean", outputs, 0), stddev,
                  Weights("mixture.mean").values);
    const std::string deviation =
        AddScaled("posterior_log_stddev",
                  AddHalf("scenario_encoder.log_variance", outputs, spec_.latent_dimensions()),
                  half, log_stddev);
    return {mean, graph_.Add("Exp", "posterior_stddev", {deviation})};
  }

  // The mean, then + and - one standard deviation along each dimension (sigma_points.h), by a
  // product with ones and zeros: [mean, stddev] [N K, 2D] -> [N K, (2D+1) D].
  std::string AddSigmaPoints(const std::string& moments) {
    const int64_t D = spec_.latent_dimensions();
    const int64_t points = 2 * D + 1;
    std::vector<float> steps(static_cast<size_t>(2 * D * points * D), 0.0f);
    const auto step = [&](int64_t input, int64_t point, int64_t d) -> float& {
      return steps[static_cast<size_t>((point * D + d) * 2 * D + input)];
    };
    for (int64_t d = 0; d < D; ++d) {
      for (int64_t point = 0; point < points; ++point) step(d, point, d) = 1.0f;
      step(D + d, 2 * d + 1, d) = 1.0f;
      step(D + d, 2 * d + 2, d) = -1.0f;
    }
    return graph_.Add("Gemm", "sigma_points",
                      {moments, graph_.Floats("sigma_steps", {points * D, 2 * D}, steps)},
                      {Setting::One("transB", 1)});
  }

  void AddDistributions(const std::string& features) {
    const int64_t K = spec_.actions();
    const int64_t D = spec_.latent_dimensions();
    const int64_t T = spec_.trajectory().waypoints();
    const int64_t points = 2 * D + 1;
    const auto rows = [&](int64_t of_each_scene) {
      return scenes_ == kAnyNumber ? kAnyNumber : scenes_ * of_each_scene;
    };
    const auto [mean, stddev] = AddPosteriors(features);
    const std::string moments = graph_.Add("Concat", "posterior_moments",
                                           {Reshape("posterior_mean.rows", mean, {rows(K), D}),
                                            Reshape("posterior_stddev.rows", stddev, {rows(K), D})},
                                           {Setting::One("axis", 1)});
    const std::string decoded =
        AddMlp("decoder", spec_.decoder().hidden_size() + 1,
               Reshape("sigma_points.rows", AddSigmaPoints(moments), {rows(K * points), D}));
    const std::string metres = AddScaled("positions", decoded, Weights("trajectory.stddev").values,
                                         Weights("trajectory.mean").values);
    Reshape("latent_mean", mean, {scenes_, K, D});
    Reshape("latent_stddev", stddev, {scenes_, K, D});
    Reshape("trajectories", metres, {scenes_, K, points, T, 2});
    graph_.Output("latent_mean", {scenes_, K, D});
    graph_.Output("latent_stddev", {scenes_, K, D});
    graph_.Output("trajectories", {scenes_, K, points, T, 2});
  }

  const artifact::StoredModel& model_;
  const v1::ModelSpec& spec_;
  const int64_t scenes_;
  GraphBuilder graph_;
};

}  // namespace

std::string ExportOnnx(const artifact::StoredModel& model, const ExportOptions& options) {
  ModelProto file;
  file.set_ir_version(kFormat);
  file.set_producer_name("maneuver");
  file.add_opset_import()->set_version(kOperators);
  StringStringEntryProto* weights = file.add_metadata_props();
  weights->set_key("weights_sha256");
  weights->set_value(model.manifest.weights_sha256());
  file.mutable_graph()->set_name("maneuver");
  Exporter(model, options.scenes, file.mutable_graph()).AddEverything(options.distributions);
  return file.SerializeAsString();
}

}  // namespace maneuver::onnx
