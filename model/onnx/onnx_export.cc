#include "model/onnx/onnx_export.h"

#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <cmath>
#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/action_names.h"
#include "model/onnx/graph_builder.h"
#include "model/scene/action_geometry.h"
#include "model/scene/agent_inputs.h"
#include "model/scene/lane_path_inputs.h"
#include "model/scene/target_history.h"
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
// Subtracted from the scores of absent elements: e to the minus this is 0 in f32.
constexpr float kHidden = 1e4f;

class Exporter {
 public:
  Exporter(const artifact::StoredModel& model, int scenes, GraphProto* graph)
      : model_(model),
        spec_(model.manifest.spec()),
        scenes_(scenes > 0 ? scenes : kAnyNumber),
        graph_(graph) {}

  void AddEverything(bool distributions) {
    const std::string features =
        spec_.has_scene_vectors() ? AddVectorFeatures() : AddRasterFeatures();
    std::string logits =
        AddMlp("action_predictor", spec_.action_predictor().hidden_size() + 1, features);
    if (spec_.has_action_geometry()) {
      AddActionGeometry(features);
      logits = graph_.Add(
          "Add", "logits",
          {logits, Reshape("action_geometry.logits", AddDense("action_geometry.logit", geometry_),
                           {scenes_, spec_.actions()})});
      AddGenericTrajectories();
    }
    graph_.Add("Softmax", "probabilities", {logits}, {Attribute::One("axis", 1)});
    graph_.Output("features", {scenes_, artifact::SceneFeatureCount(spec_)});
    graph_.Output("probabilities", {scenes_, spec_.actions()});
    if (distributions) AddDistributions(features);
  }

 private:
  const Tensor& Weights(const std::string& name) const { return model_.weights.at(name); }

  std::string AddWeights(const std::string& name) {
    const Tensor& tensor = Weights(name);
    return AddConstant(name, tensor.shape, tensor.values);
  }

  // Adds a constant, or finds it if another node asked for this name.
  std::string AddConstant(const std::string& name, const Sizes& sizes,
                          std::span<const float> values) {
    return constants_.insert(name).second ? graph_.Floats(name, sizes, values) : name;
  }

  // Returns the number of rows: `of_each_scene` for each scene.
  int64_t Rows(int64_t of_each_scene) const {
    return scenes_ == kAnyNumber ? kAnyNumber : scenes_ * of_each_scene;
  }

  std::string AddConvolution(const BackboneLayer& layer, const std::string& source,
                             const std::string& shortcut) {
    const int64_t kernel = layer.kernel, pad = kernel / 2, stride = layer.stride;
    std::string grid =
        graph_.Add("Conv", layer.convolution, {source, AddWeights(layer.convolution + ".weight")},
                   {Attribute::List("kernel_shape", {kernel, kernel}),
                    Attribute::List("strides", {stride, stride}),
                    Attribute::List("pads", {pad, pad, pad, pad})});
    std::vector<std::string> inputs = {grid};
    for (const char* part : {".weight", ".bias", ".running_mean", ".running_var"}) {
      inputs.push_back(AddWeights(layer.normalization + part));
    }
    grid = graph_.Add("BatchNormalization", layer.normalization, inputs,
                      {Attribute::Real("epsilon", kNormalizationEpsilon)});
    if (layer.adds) grid = graph_.Add("Add", layer.normalization + ".sum", {grid, shortcut});
    if (layer.relu) grid = graph_.Add("Relu", layer.normalization + ".relu", {grid});
    return grid;
  }

  // Adds the backbone's features before the ReLU, [N, F].
  std::string AddBackbone() {
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
                          {Attribute::List("kernel_shape", {kernel, kernel}),
                           Attribute::List("strides", {stride, stride}),
                           Attribute::List("pads", {pad, pad, pad, pad})});
      } else {
        grid = graph_.Add("GlobalAveragePool", absl::StrCat(source, ".average"), {source});
      }
      registers[layer.destination] = grid;
      last = layer.destination;
    }
    const std::string flat = graph_.Add("Flatten", "flat", {registers[last]});
    return AddDense("backbone.projection", flat);
  }

  // Adds the features of a model without scene vectors, [N, F'].
  std::string AddRasterFeatures() {
    const std::string projected = AddBackbone();
    if (!spec_.target_motion()) return graph_.Add("Relu", "features", {projected});
    graph_.Input("motion", {scenes_, scene::kMotionInputs});
    return graph_.Add("Concat", "features",
                      {graph_.Add("Relu", "projected", {projected}), "motion"},
                      {Attribute::One("axis", 1)});
  }

  // Adds y = W x, plus b if there is a bias. `network` selects among weights [networks, out, in].
  //   label: names this use of the weights if there are several.
  std::string AddDense(const std::string& name, const std::string& input,
                       const int64_t* network = nullptr, const std::string& label = "") {
    const Tensor& weight = Weights(name + ".weight");
    const int64_t inputs = weight.shape.back();
    const int64_t outputs = weight.shape[weight.shape.size() - 2];
    const int64_t number = network == nullptr ? 0 : *network;
    const std::string full = network == nullptr ? name : absl::StrCat(name, ".action.", number);
    const auto part = [&](const Tensor& tensor, int64_t size) {
      return std::span(tensor.values)
          .subspan(static_cast<size_t>(number * size), static_cast<size_t>(size));
    };
    std::vector<std::string> operands = {
        input, AddConstant(full + ".weight", {outputs, inputs}, part(weight, outputs * inputs))};
    if (const auto bias = model_.weights.find(name + ".bias"); bias != model_.weights.end()) {
      operands.push_back(AddConstant(full + ".bias", {outputs}, part(bias->second, outputs)));
    }
    return graph_.Add("Gemm", full + label, operands, {Attribute::One("transB", 1)});
  }

  std::string AddRelu(const std::string& x) { return graph_.Add("Relu", x + ".relu", {x}); }

  // Adds the layers `<name>.0`, `<name>.1`, ... with ReLU between them.
  std::string AddMlp(const std::string& name, int layers, std::string x,
                     const int64_t* network = nullptr, const std::string& label = "") {
    for (int i = 0; i < layers; ++i) {
      x = AddDense(absl::StrCat(name, ".", i), x, network, label);
      if (i + 1 < layers) x = AddRelu(x);
    }
    return x;
  }

  // Adds W_k x_k for each action k, [N, K, 1, out], with weights [K, out, in].
  //   x: [N K, in]
  std::string AddDenseOfEachAction(const std::string& name, const std::string& x) {
    const Tensor& weight = Weights(name + ".weight");
    const int64_t K = weight.shape[0], outputs = weight.shape[1], inputs = weight.shape[2];
    std::vector<float> transposed(weight.values.size());
    for (int64_t k = 0; k < K; ++k) {
      for (int64_t o = 0; o < outputs; ++o) {
        for (int64_t i = 0; i < inputs; ++i) {
          transposed[static_cast<size_t>((k * inputs + i) * outputs + o)] =
              weight.values[static_cast<size_t>((k * outputs + o) * inputs + i)];
        }
      }
    }
    return graph_.Add("MatMul", name,
                      {Reshape(name + ".each", x, {scenes_, K, 1, inputs}),
                       AddConstant(name + ".weight", {1, K, inputs, outputs}, transposed)});
  }

  // Adds the features of a model with scene vectors, [N, F'] (tensor.h).
  std::string AddVectorFeatures() {
    graph_.Input("history", {scenes_, scene::kHistoryInputs});
    const std::string own =
        AddRelu(AddDense("history.1", AddRelu(AddDense("history.0", "history"))));
    std::vector<std::string> parts = {own};
    const v1::SceneVectorsSpec& vectors = spec_.scene_vectors();
    const auto add_pooled = [&](const std::string& name, const Set& set, int64_t width,
                                int64_t heads) {
      const Pooled pooled = AddPooling(name, set, set.elements, 1, width, heads);
      parts.insert(parts.end(), {pooled.attended, pooled.maximum});
    };
    if (artifact::ReadsLanePaths(spec_)) {
      paths_ = AddSet("lane_path", scene::kMostLanePaths, scene::kLanePathInputs,
                      vectors.path_width(), own);
      add_pooled("lane_path", paths_, vectors.path_width(), vectors.attention_heads());
    }
    if (artifact::ReadsAgents(spec_)) {
      const Set agents =
          AddSet("agent", scene::kMostNearAgents, scene::kAgentInputs, vectors.agent_width(), own);
      add_pooled("agent", agents, vectors.agent_width(), vectors.agent_heads());
    }
    if (spec_.has_raster()) parts.push_back(AddRelu(AddBackbone()));
    return graph_.Add(
        "Relu", "features",
        {AddDense("join", graph_.Add("Concat", "joined", parts, {Attribute::One("axis", 1)}))});
  }

  // A set with room for `size` elements in each scene.
  struct Set {
    int64_t size = 0;
    std::string elements;  // [N size, width], none below 0
    std::string mask;      // 1 for a present element, else 0, [N, 1, size, 1]
    std::string gate;      // 0 for a present element, else -kHidden
  };
  // Reads the inputs `<name>s`, [N, size, numbers], and `<name>_mask`, [N, size].
  Set AddSet(const std::string& name, int64_t size, int64_t numbers, int64_t width,
             const std::string& own) {
    const std::string inputs = name + "s", input_mask = name + "_mask";
    graph_.Input(inputs, {scenes_, size, numbers});
    graph_.Input(input_mask, {scenes_, size});
    const float huge[] = {kHidden}, minus_huge[] = {-kHidden};
    Set set;
    set.size = size;
    set.mask = Reshape(input_mask + ".each", input_mask, {scenes_, 1, size, 1});
    set.gate = AddScaled(name + "_gate", set.mask, huge, minus_huge);
    const std::string rows = Reshape(inputs + ".rows", inputs, {Rows(size), numbers});
    const std::string alone = AddDense(name + ".1", AddRelu(AddDense(name + ".0", rows)));
    const std::string sum =
        graph_.Add("Add", name + ".sum",
                   {Reshape(name + ".alone", alone, {scenes_, size, width}),
                    Reshape(name + ".own", AddDense(name + ".history", own), {scenes_, 1, width})});
    set.elements = AddRelu(
        AddDense(name + ".output", Reshape(name + ".rows", AddRelu(sum), {Rows(size), width})));
    return set;
  }

  struct Pooled {
    std::string attended;  // [N S, width]
    std::string maximum;   // [N S, width]
  };
  // Pools over the present elements of `set`. `elements` holds S such sets for each scene.
  //   elements: [N S size, width], none below 0
  Pooled AddPooling(const std::string& name, const Set& set, const std::string& elements,
                    int64_t sets, int64_t width, int64_t heads) {
    const int64_t size = set.size;
    const int64_t channels = width / heads;
    const int64_t element_axis[] = {2};
    const std::string scores = Reshape(name + ".scores", AddDense(name + ".attention", elements),
                                       {scenes_, sets, size, heads});
    // Absent elements have weight 0. If all elements are absent, all weights are 0.
    const std::string shown = graph_.Add("Add", name + ".gated", {scores, set.gate});
    const std::string softmax =
        graph_.Add("Softmax", name + ".softmax", {shown}, {Attribute::One("axis", 2)});
    const std::string weights = graph_.Add("Mul", name + ".weights", {softmax, set.mask});
    const std::string weighted =
        graph_.Add("Mul", name + ".weighted",
                   {Reshape(name + ".weights.each", weights, {scenes_, sets, size, heads, 1}),
                    Reshape(name + ".channels", elements, {scenes_, sets, size, heads, channels})});
    const std::string attended =
        graph_.Add("ReduceSum", name + ".attended",
                   {weighted, graph_.Integers(name + ".attended.axes", element_axis)},
                   {Attribute::One("keepdims", 0)});
    const std::string there =
        graph_.Add("Mul", name + ".there",
                   {Reshape(name + ".elements", elements, {scenes_, sets, size, width}), set.mask});
    const std::string maximum =
        graph_.Add("ReduceMax", name + ".maximum", {there},
                   {Attribute::List("axes", {2}), Attribute::One("keepdims", 0)});
    return {Reshape(name + ".attended.rows", attended, {Rows(sets), width}),
            Reshape(name + ".maximum.rows", maximum, {Rows(sets), width})};
  }

  // Adds h_y of all actions, [N K, A], and keeps it in geometry_.
  void AddActionGeometry(const std::string& features) {
    const int64_t K = spec_.actions();
    const int64_t paths = scene::kMostLanePaths;
    const int64_t G = spec_.action_geometry().pair_width();
    const int64_t A = spec_.action_geometry().features();
    const auto dense = [&](const char* layer, const std::string& x) {
      return AddDense(absl::StrCat("action_geometry.", layer), x);
    };
    const auto add = [&](const char* name, const std::string& a, const std::string& b) {
      return graph_.Add("Add", absl::StrCat("action_geometry.", name), {a, b});
    };
    graph_.Input("action_paths", {scenes_, K, paths, scene::kPairNumbers});
    graph_.Input("action_numbers", {scenes_, K, scene::kActionNumbers});
    const std::string pairs =
        Reshape("action_paths.rows", "action_paths", {Rows(K * paths), scene::kPairNumbers});
    const std::string of_pair =
        Reshape("action_geometry.of_pair", dense("pair", pairs), {scenes_, K, paths, G});
    const std::string of_path =
        Reshape("action_geometry.of_path", dense("path", paths_.elements), {scenes_, 1, paths, G});
    const std::string of_scene =
        Reshape("action_geometry.of_scene", dense("scene", features), {scenes_, 1, 1, G});
    const std::string of_action = AddConstant("action_geometry.action.bias", {1, K, 1, G},
                                              Weights("action_geometry.action.bias").values);
    const std::string first = AddRelu(add("first", add("pair_and_path", of_pair, of_path),
                                          add("scene_and_action", of_scene, of_action)));
    const std::string second = AddRelu(
        dense("hidden", Reshape("action_geometry.first.rows", first, {Rows(K * paths), G})));
    const Pooled pooled = AddPooling("action_geometry", paths_, second, K, G,
                                     spec_.action_geometry().attention_heads());
    const std::string numbers =
        Reshape("action_numbers.rows", "action_numbers", {Rows(K), scene::kActionNumbers});
    const std::string joined =
        graph_.Add("Concat", "action_geometry.joined", {pooled.attended, pooled.maximum, numbers},
                   {Attribute::One("axis", 1)});
    const std::string joint =
        Reshape("action_geometry.joint.each", dense("joint", joined), {scenes_, K, A});
    const std::string joint_scene = Reshape("action_geometry.joint_scene.each",
                                            dense("joint_scene", features), {scenes_, 1, A});
    const std::string joint_action =
        AddConstant("action_geometry.joint_action.bias", {1, K, A},
                    Weights("action_geometry.joint_action.bias").values);
    const std::string all =
        AddRelu(add("joint_sum", add("joint_and_scene", joint, joint_scene), joint_action));
    geometry_ =
        AddRelu(dense("output", Reshape("action_geometry.joint_sum.rows", all, {Rows(K), A})));
  }

  // Adds p(z|y) decoded at its mean, [K, T, 2].
  void AddGenericTrajectories() {
    const int64_t K = spec_.actions();
    const int64_t T = spec_.trajectory().waypoints();
    const std::string decoded = AddMlp("decoder", spec_.decoder().hidden_size() + 1,
                                       AddWeights("mixture.mean"), nullptr, ".generic");
    Reshape("generic_trajectories",
            AddScaled("generic_positions", decoded, Weights("trajectory.stddev").values,
                      Weights("trajectory.mean").values),
            {K, T, 2});
    graph_.Output("generic_trajectories", {K, T, 2});
  }

  // Adds the learned residual of each action's mean, [N, K, 1, 2T].
  std::string AddMeanResidual(const std::string& features) {
    const int64_t K = spec_.actions();
    const Tensor& scene = Weights("mean_residual.scene.weight");
    const int64_t coefficients = scene.shape[1];
    std::string sum = Reshape(
        "mean_residual.scene.each",
        graph_.Add("Gemm", "mean_residual.scene",
                   {features, AddConstant("mean_residual.scene.weight",
                                          {K * coefficients, scene.shape[2]}, scene.values)},
                   {Attribute::One("transB", 1)}),
        {scenes_, K, 1, coefficients});
    if (spec_.has_action_geometry()) {
      sum = graph_.Add("Add", "mean_residual.sum",
                       {sum, AddDenseOfEachAction("mean_residual.geometry", geometry_)});
    }
    const std::string metres =
        graph_.Add("Gemm", "mean_residual.metres",
                   {Reshape("mean_residual.rows", sum, {Rows(K), coefficients}),
                    AddWeights("mean_residual.curves")},
                   {Attribute::One("transB", 1)});
    return Reshape("mean_residual", metres,
                   {scenes_, K, 1, 2 * int64_t{spec_.trajectory().waypoints()}});
  }

  std::string Reshape(const std::string& name, const std::string& x,
                      const std::vector<int64_t>& sizes) {
    return graph_.Add("Reshape", name, {x, graph_.Integers(name + ".shape", sizes)});
  }

  // Adds one half of the outputs of the K scenario encoders, a (first = 0) or b: [N, K D].
  //   outputs: [N, K, 2D]
  std::string AddHalf(const std::string& name, const std::string& outputs, int64_t first) {
    const int64_t D = spec_.latent_dimensions();
    const int64_t begin[] = {first}, end[] = {first + D}, axis[] = {2};
    const std::string half =
        graph_.Add("Slice", name + ".each",
                   {outputs, graph_.Integers(name + ".begin", begin),
                    graph_.Integers(name + ".end", end), graph_.Integers(name + ".axis", axis)});
    return Reshape(name, half, {scenes_, spec_.actions() * D});
  }

  // Adds x * scale + offset, where both have [columns of x] values.
  std::string AddScaled(const std::string& name, const std::string& x, std::span<const float> scale,
                        std::span<const float> offset) {
    const Sizes sizes = {static_cast<int64_t>(scale.size())};
    const std::string scaled =
        graph_.Add("Mul", name + ".scaled", {x, graph_.Floats(name + ".scale", sizes, scale)});
    return graph_.Add("Add", name, {scaled, graph_.Floats(name + ".offset", sizes, offset)});
  }

  // Adds q(z|y,s) of all actions, mean and deviation, each [N, K D], relative to the components of
  // the mixture (tensor.h).
  std::pair<std::string, std::string> AddPosteriors(const std::string& features) {
    const int64_t K = spec_.actions();
    const int64_t D = spec_.latent_dimensions();
    std::vector<std::string> encoders;
    for (int64_t k = 0; k < K; ++k) {
      encoders.push_back(
          AddMlp("scenario_encoder", spec_.scenario_encoder().hidden_size() + 1, features, &k));
    }
    std::string outputs =
        Reshape("scenario_encoder.each",
                graph_.Add("Concat", "scenario_encoder", encoders, {Attribute::One("axis", 1)}),
                {scenes_, K, 2 * D});
    if (spec_.has_action_geometry()) {
      outputs =
          graph_.Add("Add", "scenario_encoder.sum",
                     {outputs, Reshape("action_geometry.latents",
                                       AddDenseOfEachAction("action_geometry.latent", geometry_),
                                       {scenes_, K, 2 * D})});
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

  // Adds the mean, then + and - one standard deviation along each dimension (sigma_points.h), by a
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
                      {Attribute::One("transB", 1)});
  }

  void AddDistributions(const std::string& features) {
    const int64_t K = spec_.actions();
    const int64_t D = spec_.latent_dimensions();
    const int64_t T = spec_.trajectory().waypoints();
    const int64_t points = 2 * D + 1;
    const auto [mean, stddev] = AddPosteriors(features);
    const std::string moments = graph_.Add("Concat", "posterior_moments",
                                           {Reshape("posterior_mean.rows", mean, {Rows(K), D}),
                                            Reshape("posterior_stddev.rows", stddev, {Rows(K), D})},
                                           {Attribute::One("axis", 1)});
    const std::string decoded =
        AddMlp("decoder", spec_.decoder().hidden_size() + 1,
               Reshape("sigma_points.rows", AddSigmaPoints(moments), {Rows(K * points), D}));
    const std::string metres =
        AddShifts(AddScaled("positions", decoded, Weights("trajectory.stddev").values,
                            Weights("trajectory.mean").values),
                  features);
    Reshape("latent_mean", mean, {scenes_, K, D});
    Reshape("latent_stddev", stddev, {scenes_, K, D});
    Reshape("trajectories", metres, {scenes_, K, points, T, 2});
    graph_.Output("latent_mean", {scenes_, K, D});
    graph_.Output("latent_stddev", {scenes_, K, D});
    graph_.Output("trajectories", {scenes_, K, points, T, 2});
  }

  // Adds the residual of the mean and the reference, where the model has them, to decoded
  // positions.
  //   positions: [N K (2D+1), 2T] metres
  std::string AddShifts(std::string positions, const std::string& features) {
    const bool relative = artifact::HasReference(spec_);
    if (!spec_.mean_residual() && !relative) return positions;
    const int64_t T = spec_.trajectory().waypoints();
    positions = Reshape("positions.each", positions,
                        {scenes_, spec_.actions(), 2 * spec_.latent_dimensions() + 1, 2 * T});
    if (spec_.mean_residual()) {
      positions = graph_.Add("Add", "positions.of_scene", {positions, AddMeanResidual(features)});
    }
    if (!relative) return positions;
    graph_.Input("reference", {scenes_, T, 2});
    return graph_.Add("Add", "positions.of_target",
                      {positions, Reshape("reference.each", "reference", {scenes_, 1, 1, 2 * T})});
  }

  const artifact::StoredModel& model_;
  const v1::ModelSpec& spec_;
  const int64_t scenes_;
  GraphBuilder graph_;
  std::set<std::string> constants_;
  Set paths_;             // lane paths; elements: l_i
  std::string geometry_;  // h_y of all actions, [N K, A]
};

// Display names of the actions, in the order of their ids: a JSON array of strings.
std::string ActionNames(const v1::ModelManifest& manifest) {
  google::protobuf::ListValue names;
  for (const std::string& name : evaluation::DisplayNames(manifest)) {
    names.add_values()->set_string_value(name);
  }
  std::string json;
  // A list of strings has nothing that cannot be stated.
  (void)google::protobuf::util::MessageToJsonString(names, &json);
  return json;
}

}  // namespace

std::string ExportOnnx(const artifact::StoredModel& model, const OnnxOptions& options) {
  ModelProto file;
  file.set_ir_version(kFormat);
  file.set_producer_name("maneuver");
  file.add_opset_import()->set_version(kOperators);
  StringStringEntryProto* weights = file.add_metadata_props();
  weights->set_key("weights_sha256");
  weights->set_value(model.manifest.weights_sha256());
  StringStringEntryProto* names = file.add_metadata_props();
  names->set_key("action_names");
  names->set_value(ActionNames(model.manifest));
  file.mutable_graph()->set_name("maneuver");
  Exporter(model, options.scenes, file.mutable_graph()).AddEverything(options.distributions);
  return file.SerializeAsString();
}

}  // namespace maneuver::onnx
