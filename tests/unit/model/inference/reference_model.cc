#include "tests/unit/model/inference/reference_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "model/artifact/backbone_layers.h"
#include "model/artifact/model_spec.h"
#include "model/scene/action_geometry.h"
#include "model/scene/motion_reference.h"

namespace maneuver::inference {

artifact::StoredModel RandomModel(const v1::ModelSpec& spec, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  artifact::StoredModel model;
  *model.manifest.mutable_spec() = spec;
  for (const auto& [name, shape] : artifact::TensorShapes(spec)) {
    artifact::Tensor& tensor = model.weights[name];
    tensor.shape = shape;
    size_t count = 1;
    for (const int64_t size : shape) count *= static_cast<size_t>(size);
    // He initialisation for what has inputs; 0.3 for the rest.
    float scale = 0.3f;
    if (name.ends_with(".weight") && shape.size() >= 2) {
      const bool convolution = shape.size() == 4;
      const int64_t inputs = convolution ? shape[1] * shape[2] * shape[3] : shape.back();
      scale = std::sqrt(2.0f / static_cast<float>(inputs));
    }
    for (size_t i = 0; i < count; ++i) tensor.values.push_back(scale * normal(random));
    const bool positive =
        name.ends_with("running_var") || name == "trajectory.stddev" ||
        name == "scene_covariance.speed_factor" ||
        (name.find("normalization") != std::string::npos && name.ends_with(".weight"));
    if (positive) {
      for (float& value : tensor.values) value = 0.5f + std::abs(value);
    }
  }
  // Sums of many blocks stay of order 1, too.
  for (const artifact::BackboneLayer& layer : artifact::BackboneLayers(spec)) {
    if (!layer.adds) continue;
    for (float& gamma : model.weights[layer.normalization + ".weight"].values) gamma *= 0.4f;
  }
  if (!model.weights.contains("decoder.covariance")) return model;
  std::vector<float>& covariance = model.weights["decoder.covariance"].values;
  for (size_t i = 0; i < covariance.size(); i += 3) {
    covariance[i] = 0.5f + std::abs(covariance[i]);
    covariance[i + 2] = 0.5f + std::abs(covariance[i + 2]);
    covariance[i + 1] = std::clamp(covariance[i + 1], -0.4f, 0.4f);
  }
  return model;
}

std::vector<uint8_t> RandomRaster(const v1::ModelSpec& spec, uint32_t seed) {
  std::mt19937 random(seed);
  const auto grid = artifact::RasterGrid(spec.raster());
  std::vector<uint8_t> raster(static_cast<size_t>(grid.channels) *
                              static_cast<size_t>(grid.height) * static_cast<size_t>(grid.width));
  const uint32_t one_in = seed % 2 == 0 ? 4 : 20;
  for (uint8_t& byte : raster) {
    byte = random() % one_in == 0 ? static_cast<uint8_t>(random() % 256) : 0;
  }
  return raster;
}

scene::SceneVectors RandomVectors(uint32_t seed, int paths, int agents) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  scene::SceneVectors vectors;
  vectors.motion.speed = 10.0 + 10.0 * uniform(random);
  vectors.motion.acceleration = 3.0 * uniform(random);
  vectors.motion.turn_rate = 0.5 * uniform(random);
  for (float& input : vectors.history) input = static_cast<float>(uniform(random));
  vectors.paths.count = paths;
  for (int p = 0; p < paths; ++p) {
    const auto path = vectors.paths.values.begin() + p * scene::kLanePathInputs;
    for (int i = 0; i < scene::kLanePathInputs; ++i) path[i] = static_cast<float>(uniform(random));
    const double offset = 3.0 * uniform(random);
    const double heading = 0.6 * uniform(random);
    const double lengths[] = {2.5, 5, 7.5, 10, 15, 20, 25, 30, 40, 50, 65, 80, 100};
    for (int i = 0; i < 13; ++i) {
      const double scale = std::max(lengths[i], 5.0);
      path[2 * i] =
          static_cast<float>((offset * std::sin(heading) + lengths[i] * std::cos(heading)) / scale);
      path[2 * i + 1] = static_cast<float>(
          (-offset * std::cos(heading) + lengths[i] * std::sin(heading)) / scale);
    }
    path[62] = static_cast<float>(offset);
    path[63] = static_cast<float>(-std::sin(heading));
    path[69] = uniform(random) > 0 ? 1.0f : 0.0f;
    path[81] = uniform(random) > 0 ? 1.0f : 0.0f;
  }
  vectors.agents.count = agents;
  for (int i = 0; i < agents * scene::kAgentInputs; ++i) {
    vectors.agents.values[static_cast<size_t>(i)] = static_cast<float>(uniform(random));
  }
  return vectors;
}

namespace {

using Values = ReferenceModel::Values;
using Rows = ReferenceModel::Rows;

Values Relu(Values x) {
  for (double& value : x) value = std::max(0.0, value);
  return x;
}

Values Sum(Values x, const Values& y) {
  for (size_t i = 0; i < x.size(); ++i) x[i] += y.at(i);
  return x;
}

Values Joined(Values x, const Values& y) {
  x.insert(x.end(), y.begin(), y.end());
  return x;
}

Values Row(const std::vector<float>& matrix, size_t row, size_t columns) {
  const auto begin = matrix.begin() + static_cast<std::ptrdiff_t>(row * columns);
  return {begin, begin + static_cast<std::ptrdiff_t>(columns)};
}

template <typename Floats>
Values Doubles(const Floats& floats, size_t first, size_t count) {
  const auto begin = floats.begin() + static_cast<std::ptrdiff_t>(first);
  return {begin, begin + static_cast<std::ptrdiff_t>(count)};
}

// [C, h, w]
struct Grid {
  int channels, height, width;
  Values values;

  size_t At(int c, int row, int column) const {
    return static_cast<size_t>((c * height + row) * width + column);
  }
};

// `cell(o, row, column)` for every place of a grid of 1/stride the size.
template <typename Cell>
Grid Strided(const Grid& x, int channels, int stride, const Cell& cell) {
  Grid y{channels, (x.height + stride - 1) / stride, (x.width + stride - 1) / stride, {}};
  for (int o = 0; o < y.channels; ++o) {
    for (int row = 0; row < y.height; ++row) {
      for (int column = 0; column < y.width; ++column) {
        y.values.push_back(cell(o, row * stride, column * stride));
      }
    }
  }
  return y;
}

Grid Relu(Grid x) {
  for (double& value : x.values) value = std::max(0.0, value);
  return x;
}

Grid Sum(Grid x, const Grid& y) {
  for (size_t i = 0; i < x.values.size(); ++i) x.values[i] += y.values.at(i);
  return x;
}

Grid MaxPool(const Grid& x) {
  return Strided(x, x.channels, 2, [&](int c, int row, int column) {
    double largest = -1e300;
    for (int r = std::max(0, row - 1); r <= std::min(x.height - 1, row + 1); ++r) {
      for (int q = std::max(0, column - 1); q <= std::min(x.width - 1, column + 1); ++q) {
        largest = std::max(largest, x.values[x.At(c, r, q)]);
      }
    }
    return largest;
  });
}

Grid AveragePool(const Grid& x) {
  Grid y{x.channels, 1, 1, {}};
  const size_t cells = static_cast<size_t>(x.height * x.width);
  for (size_t c = 0; c < static_cast<size_t>(x.channels); ++c) {
    double sum = 0;
    for (size_t i = 0; i < cells; ++i) sum += x.values[c * cells + i];
    y.values.push_back(sum / static_cast<double>(cells));
  }
  return y;
}

// One convolution with its batch normalisation. `name` has %, for which "convolution" or
// "normalization" stand.
Grid Convolve(const artifact::TensorMap& weights, const std::string& name, int stride,
              const Grid& x) {
  const auto tensor = [&](const char* part, const char* end) -> const artifact::Tensor& {
    std::string full = name + end;
    return weights.at(full.replace(full.find('%'), 1, part));
  };
  const artifact::Tensor& weight = tensor("convolution", ".weight");
  const int outputs = static_cast<int>(weight.shape[0]);
  const int kernel = static_cast<int>(weight.shape[2]);
  return Strided(x, outputs, stride, [&](int o, int row, int column) {
    double sum = 0;
    for (int c = 0; c < x.channels; ++c) {
      for (int i = 0; i < kernel; ++i) {
        for (int j = 0; j < kernel; ++j) {
          const int r = row + i - kernel / 2, q = column + j - kernel / 2;
          if (r < 0 || r >= x.height || q < 0 || q >= x.width) continue;
          const int tap = ((o * x.channels + c) * kernel + i) * kernel + j;
          sum += double{weight.values[static_cast<size_t>(tap)]} * x.values[x.At(c, r, q)];
        }
      }
    }
    const auto moment = [&](const char* end) {
      return double{tensor("normalization", end).values[static_cast<size_t>(o)]};
    };
    return (sum - moment(".running_mean")) / std::sqrt(moment(".running_var") + 1e-5) *
               moment(".weight") +
           moment(".bias");
  });
}

Grid Residual(const artifact::StoredModel& model, Grid x) {
  const v1::ResidualSpec& residual = model.manifest.spec().backbone().residual();
  const auto convolve = [&](const std::string& name, int stride, const Grid& grid) {
    return Convolve(model.weights, name, stride, grid);
  };
  x = Relu(convolve("backbone.stem.%", residual.stem().stride(), x));
  if (residual.stem().max_pool()) x = MaxPool(x);
  for (int s = 0; s < residual.stages_size(); ++s) {
    for (int b = 0; b < residual.stages(s).blocks(); ++b) {
      const std::string block =
          "backbone.stage." + std::to_string(s) + ".block." + std::to_string(b) + ".";
      const int stride = b == 0 ? residual.stages(s).stride() : 1;
      Grid y;
      if (residual.block() == v1::RESIDUAL_BLOCK_BASIC) {
        y = convolve(block + "%.1", 1, Relu(convolve(block + "%.0", stride, x)));
      } else {
        y = Relu(convolve(block + "%.0", 1, x));
        y = convolve(block + "%.2", 1, Relu(convolve(block + "%.1", stride, y)));
      }
      const bool same = y.channels == x.channels && y.height == x.height && y.width == x.width;
      x = Relu(Sum(std::move(y), same ? x : convolve(block + "shortcut.%", stride, x)));
    }
  }
  return AveragePool(x);
}

}  // namespace

ReferenceModel::Values ReferenceModel::Features(const std::vector<uint8_t>& raster) const {
  const v1::ModelSpec& spec = model_.manifest.spec();
  const int height = spec.raster().height(), width = spec.raster().width();
  Grid grid{3 + 2 * spec.raster().history_frames(), height, width, Values(raster.size())};
  for (size_t i = 0; i < raster.size(); ++i) {
    const int cell = static_cast<int>(i) / grid.channels;
    grid.values[grid.At(static_cast<int>(i) % grid.channels, cell / width, cell % width)] =
        raster[i] / 255.0;
  }
  if (spec.backbone().has_residual()) {
    grid = Residual(model_, std::move(grid));
  }
  for (int layer = 0; layer < spec.backbone().convolutions_size(); ++layer) {
    grid = Relu(Convolve(model_.weights, "backbone.%." + std::to_string(layer),
                         spec.backbone().convolutions(layer).stride(), grid));
  }
  const Values& x = grid.values;
  const std::vector<float>& weight = Tensor("backbone.projection.weight");
  const std::vector<float>& bias = Tensor("backbone.projection.bias");
  Values features(bias.size());
  for (size_t o = 0; o < features.size(); ++o) {
    double sum = bias[o];
    for (size_t i = 0; i < x.size(); ++i) sum += double{weight[o * x.size() + i]} * x[i];
    features[o] = std::max(0.0, sum);
  }
  return features;
}

ReferenceModel::Values ReferenceModel::Mlp(const std::string& name, int layers, Values x,
                                           int network) const {
  for (int layer = 0; layer < layers; ++layer) {
    const std::string prefix = name + "." + std::to_string(layer);
    const std::vector<float>& weight = Tensor(prefix + ".weight");
    const std::vector<float>& bias = Tensor(prefix + ".bias");
    const size_t inputs = x.size();
    const size_t outputs = static_cast<size_t>(model_.weights.at(prefix + ".bias").shape.back());
    const size_t first = static_cast<size_t>(network) * outputs;
    Values y(outputs);
    for (size_t o = 0; o < outputs; ++o) {
      double sum = bias[first + o];
      for (size_t i = 0; i < inputs; ++i) sum += double{weight[(first + o) * inputs + i]} * x[i];
      y[o] = layer + 1 < layers ? std::max(0.0, sum) : sum;
    }
    x = std::move(y);
  }
  return x;
}

ReferenceModel::Values ReferenceModel::Probabilities(const Scene& scene) const {
  Values logits =
      Mlp("action_predictor", spec().action_predictor().hidden_size() + 1, scene.features);
  for (size_t k = 0; k < scene.geometry.size(); ++k) {
    logits[k] += Linear("action_geometry.logit", scene.geometry[k])[0];
  }
  long double sum = 0;
  for (const double logit : logits) sum += std::exp(static_cast<long double>(logit));
  for (double& logit : logits) {
    logit = static_cast<double>(std::exp(static_cast<long double>(logit)) / sum);
  }
  return logits;
}

ReferenceModel::Values ReferenceModel::Posterior(const Scene& scene, int k) const {
  const size_t D = static_cast<size_t>(spec().latent_dimensions());
  Values output =
      Mlp("scenario_encoder", spec().scenario_encoder().hidden_size() + 1, scene.features, k);
  if (!scene.geometry.empty()) {
    output =
        Sum(output, Linear("action_geometry.latent", scene.geometry[static_cast<size_t>(k)], k));
  }
  for (size_t d = 0; d < D; ++d) {
    const double mean = Tensor("mixture.mean")[static_cast<size_t>(k) * D + d];
    const double log_variance = Tensor("mixture.log_variance")[static_cast<size_t>(k) * D + d];
    output[d] = mean + std::sqrt(std::exp(log_variance)) * output[d];
    output[D + d] += log_variance;
  }
  return output;
}

ReferenceModel::Values ReferenceModel::EncodeTrajectory(const Values& x) const {
  Values standardized(x.size());
  for (size_t i = 0; i < x.size(); ++i) {
    standardized[i] = (x[i] - Tensor("trajectory.mean")[i]) / Tensor("trajectory.stddev")[i];
  }
  return Mlp("trajectory_encoder", model_.manifest.spec().trajectory_encoder().hidden_size() + 1,
             standardized);
}

ReferenceModel::Values ReferenceModel::Decode(const Values& z) const {
  Values x = Mlp("decoder", model_.manifest.spec().decoder().hidden_size() + 1, z);
  for (size_t i = 0; i < x.size(); ++i) {
    x[i] = x[i] * Tensor("trajectory.stddev")[i] + Tensor("trajectory.mean")[i];
  }
  return x;
}

ReferenceModel::Values ReferenceModel::Responsibilities(const Scene& scene, const Values& x) const {
  const v1::ModelSpec& spec = model_.manifest.spec();
  const size_t K = static_cast<size_t>(spec.actions());
  const size_t D = static_cast<size_t>(spec.latent_dimensions());
  const Values prior = Probabilities(scene);
  Values relative = x;
  for (size_t i = 0; i < scene.reference.size(); ++i) relative[i] -= scene.reference[i];
  const Values q = EncodeTrajectory(relative);
  std::vector<long double> joint(K);
  long double sum = 0;
  for (size_t k = 0; k < K; ++k) {
    const Values posterior = Posterior(scene, static_cast<int>(k));
    double cross_entropy = 0, divergence = 0;
    for (size_t d = 0; d < D; ++d) {
      const double mean = Tensor("mixture.mean")[k * D + d];
      const double variance = std::exp(double{Tensor("mixture.log_variance")[k * D + d]});
      const auto second_moment = [&](double m, double log_variance) {
        return std::exp(log_variance) + (m - mean) * (m - mean);
      };
      cross_entropy += 0.5 * std::log(2 * std::numbers::pi * variance) +
                       0.5 * second_moment(q[d], q[D + d]) / variance;
      divergence += 0.5 * (std::log(variance) - posterior[D + d]) - 0.5 +
                    0.5 * second_moment(posterior[d], posterior[D + d]) / variance;
    }
    joint[k] = prior[k] * std::exp(static_cast<long double>(-cross_entropy - divergence));
    sum += joint[k];
  }
  Values responsibilities(K);
  for (size_t k = 0; k < K; ++k) responsibilities[k] = static_cast<double>(joint[k] / sum);
  return responsibilities;
}

ReferenceModel::Values ReferenceModel::Linear(const std::string& name, const Values& x,
                                              int network) const {
  const std::vector<int64_t>& shape = Shape(name + ".weight");
  const size_t inputs = static_cast<size_t>(shape.back());
  const size_t outputs = static_cast<size_t>(shape[shape.size() - 2]);
  const std::vector<float>& weight = Tensor(name + ".weight");
  const bool has_bias = model_.weights.contains(name + ".bias");
  Values y(outputs);
  for (size_t o = 0; o < outputs; ++o) {
    const size_t row = static_cast<size_t>(network) * outputs + o;
    if (has_bias) y[o] = Tensor(name + ".bias")[row];
    for (size_t i = 0; i < inputs; ++i) y[o] += double{weight[row * inputs + i]} * x.at(i);
  }
  return y;
}

ReferenceModel::Values ReferenceModel::Pool(const std::string& name, const Rows& elements,
                                            int heads, size_t width) const {
  Values pooled(2 * width, 0.0);
  Rows scores;
  for (const Values& element : elements) scores.push_back(Linear(name + ".attention", element));
  for (size_t c = 0; c < width; ++c) {
    const size_t head = c * static_cast<size_t>(heads) / width;
    double sum = 0;
    for (const Values& score : scores) sum += std::exp(score[head]);
    for (size_t i = 0; i < elements.size(); ++i) {
      pooled[c] += std::exp(scores[i][head]) / sum * elements[i][c];
      pooled[width + c] = std::max(pooled[width + c], elements[i][c]);
    }
  }
  return pooled;
}

ReferenceModel::Rows ReferenceModel::Elements(const std::string& name,
                                              std::span<const float> inputs, int count,
                                              const Values& own) const {
  const auto numbers = static_cast<size_t>(Shape(name + ".0.weight")[1]);
  Rows elements;
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) {
    const auto row = inputs.subspan(i * numbers, numbers);
    const Values alone =
        Linear(name + ".1", Relu(Linear(name + ".0", Values(row.begin(), row.end()))));
    const Values both = Relu(Sum(alone, Linear(name + ".history", own)));
    elements.push_back(Relu(Linear(name + ".output", both)));
  }
  return elements;
}

ReferenceModel::Scene ReferenceModel::Encode(const scene::SceneVectors& vectors,
                                             const Values& raster_features) const {
  Scene scene;
  scene.speed = vectors.motion.speed;
  const std::vector<double> times = artifact::WaypointTimes(spec().trajectory());
  scene.reference.resize(2 * times.size());
  scene::RollOut(spec().reference(), spec().inputs_version(), vectors.motion, times,
                 scene.reference);

  const Values own = Relu(Linear(
      "history.1", Relu(Linear("history.0", Doubles(vectors.history, 0, scene::kHistoryInputs)))));
  Values joined = own;
  Rows paths;
  const v1::SceneVectorsSpec& sizes = spec().scene_vectors();
  if (sizes.path_width() > 0) {
    paths = Elements("lane_path", vectors.paths.values, vectors.paths.count, own);
    joined = Joined(joined, Pool("lane_path", paths, sizes.attention_heads(),
                                 static_cast<size_t>(sizes.path_width())));
  }
  if (sizes.agent_width() > 0) {
    const Rows agents = Elements("agent", vectors.agents.values, vectors.agents.count, own);
    joined = Joined(joined, Pool("agent", agents, sizes.agent_heads(),
                                 static_cast<size_t>(sizes.agent_width())));
  }
  scene.features = Relu(Linear("join", Joined(joined, raster_features)));
  if (spec().has_action_geometry()) scene.geometry = Geometry(vectors, scene, paths);
  return scene;
}

ReferenceModel::Rows ReferenceModel::Geometry(const scene::SceneVectors& vectors,
                                              const Scene& scene, const Rows& paths) const {
  const size_t K = static_cast<size_t>(spec().actions());
  const size_t D = static_cast<size_t>(spec().latent_dimensions());
  const scene::GeometryWaypoints waypoints =
      scene::FindGeometryWaypoints(artifact::WaypointTimes(spec().trajectory()));
  std::vector<scene::ActionPoints> points(K);
  for (size_t k = 0; k < K; ++k) {
    const Values x = Sum(Decode(Row(Tensor("mixture.mean"), k, D)), scene.reference);
    for (size_t t = 0; t < scene::kGeometryTimes; ++t) {
      for (size_t axis = 0; axis < 2; ++axis) {
        const auto at = [&](int waypoint) {
          return waypoint < 0 ? 0.0f
                              : static_cast<float>(x[2 * static_cast<size_t>(waypoint) + axis]);
        };
        points[k].at[t][axis] = at(waypoints.at[t]);
        points[k].before[t][axis] = at(waypoints.before[t]);
      }
    }
  }
  std::vector<float> pairs(K * scene::kMostLanePaths * scene::kPairNumbers);
  std::vector<float> actions(K * scene::kActionNumbers);
  scene::DescribeActions(points, waypoints, vectors.paths, vectors.motion.speed,
                         spec().inputs_version(), pairs, actions);

  const std::string name = "action_geometry.";
  const size_t G = static_cast<size_t>(spec().action_geometry().pair_width());
  const size_t A = static_cast<size_t>(spec().action_geometry().features());
  Rows geometry;
  for (size_t k = 0; k < K; ++k) {
    Rows elements;
    for (size_t i = 0; i < paths.size(); ++i) {
      const size_t pair = (k * scene::kMostLanePaths + i) * scene::kPairNumbers;
      Values g = Linear(name + "pair", Doubles(pairs, pair, scene::kPairNumbers));
      g = Sum(g, Linear(name + "path", paths[i]));
      g = Sum(g, Linear(name + "scene", scene.features));
      g = Relu(Sum(g, Row(Tensor(name + "action.bias"), k, G)));
      elements.push_back(Relu(Linear(name + "hidden", g)));
    }
    const Values pooled =
        Pool("action_geometry", elements, spec().action_geometry().attention_heads(), G);
    const Values own = Doubles(actions, k * scene::kActionNumbers, scene::kActionNumbers);
    Values joint = Linear(name + "joint", Joined(pooled, own));
    joint = Sum(joint, Linear(name + "joint_scene", scene.features));
    joint = Relu(Sum(joint, Row(Tensor(name + "joint_action.bias"), k, A)));
    geometry.push_back(Relu(Linear(name + "output", joint)));
  }
  return geometry;
}

ReferenceModel::Values ReferenceModel::MeanResidual(const Scene& scene, int k) const {
  const Values& f = scene.features;
  Values coefficients = Linear("mean_residual.scene", f, k);
  if (!scene.geometry.empty()) {
    const Values& h = scene.geometry[static_cast<size_t>(k)];
    coefficients = Sum(coefficients, Linear("mean_residual.geometry", h, k));
  }
  Values metres(static_cast<size_t>(Shape("mean_residual.curves")[0]), 0.0);
  for (size_t i = 0; i < metres.size(); ++i) {
    for (size_t m = 0; m < coefficients.size(); ++m) {
      metres[i] +=
          double{Tensor("mean_residual.curves")[i * coefficients.size() + m]} * coefficients[m];
    }
  }
  return metres;
}

ReferenceModel::Rows ReferenceModel::SceneCovariance(const Scene& scene, int k,
                                                     const Values& mean) const {
  const Values a =
      Mlp("scene_covariance", spec().scene_covariance().hidden_size() + 1, scene.features, k);
  const std::vector<double> times = artifact::WaypointTimes(spec().trajectory());
  const double interval = times[0];
  const double h = times.back();
  const double v = std::abs(scene.speed);
  const size_t bin = v < 0.5 ? 0 : v < 2 ? 1 : v < 5 ? 2 : v < 10 ? 3 : v < 15 ? 4 : 5;
  const int T = static_cast<int>(times.size());
  const int window = static_cast<int>(std::lround(0.2 / interval));
  Rows covariances;
  for (int t = 0; t < T; ++t) {
    // The mean of the steps in the window, one after another.
    double dx = 0, dy = 0;
    int steps = 0;
    for (int i = std::max(0, t - window); i <= std::min(T - 1, t + window); ++i, ++steps) {
      const size_t at = 2 * static_cast<size_t>(i);
      dx += mean[at] - (i > 0 ? mean[at - 2] : 0.0);
      dy += mean[at + 1] - (i > 0 ? mean[at - 1] : 0.0);
    }
    const double length = std::hypot(dx, dy);
    const bool moves = length / steps >= 0.5 * interval;
    const double angle = moves ? std::atan2(dy, dx) : 0.0;
    double variance[2];
    for (size_t axis = 0; axis < 2; ++axis) {
      const double time = times[static_cast<size_t>(t)];
      const double share = 2 * time / h;
      const double* n = &a[4 * axis];
      const double log_stddev =
          n[0] + n[1] * std::log(share) + n[2] * (share - 1) + n[3] * std::exp(-time);
      variance[axis] = std::pow(std::exp(std::clamp(log_stddev, -3.0, 4.0)), 2) *
                       Tensor("scene_covariance.speed_factor")[2 * bin + axis];
    }
    const double c = std::cos(angle), s = std::sin(angle);
    covariances.push_back({c * c * variance[0] + s * s * variance[1],
                           c * s * (variance[0] - variance[1]),
                           s * s * variance[0] + c * c * variance[1]});
  }
  return covariances;
}

}  // namespace maneuver::inference
