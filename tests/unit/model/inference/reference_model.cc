#include "tests/unit/model/inference/reference_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "model/artifact/model_spec.h"

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
      const int64_t inputs = convolution ? shape[1] * 9 : shape.back();
      scale = std::sqrt(2.0f / static_cast<float>(inputs));
    }
    for (size_t i = 0; i < count; ++i) tensor.values.push_back(scale * normal(random));
    const bool positive =
        name.ends_with("running_var") || name == "trajectory.stddev" ||
        (name.find("normalization") != std::string::npos && name.ends_with(".weight"));
    if (positive) {
      for (float& value : tensor.values) value = 0.5f + std::abs(value);
    }
  }
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
  const auto grid = artifact::BackboneGrid(spec, 0);
  std::vector<uint8_t> raster(static_cast<size_t>(grid.channels) *
                              static_cast<size_t>(grid.height) * static_cast<size_t>(grid.width));
  for (uint8_t& byte : raster) byte = random() % 4 == 0 ? static_cast<uint8_t>(random() % 256) : 0;
  return raster;
}

ReferenceModel::Values ReferenceModel::Features(const std::vector<uint8_t>& raster) const {
  const v1::ModelSpec& spec = model_.manifest.spec();
  const auto input = artifact::BackboneGrid(spec, 0);
  int channels = input.channels, height = input.height, width = input.width;
  Values x(raster.size());  // [C, h, w]
  for (int c = 0; c < channels; ++c) {
    for (int i = 0; i < height * width; ++i) {
      x[static_cast<size_t>(c * height * width + i)] =
          raster[static_cast<size_t>(i * channels + c)] / 255.0;
    }
  }
  for (int layer = 0; layer < spec.backbone().convolutions_size(); ++layer) {
    const std::string index = std::to_string(layer);
    const std::vector<float>& weight = Tensor("backbone.convolution." + index + ".weight");
    const std::string normalization = "backbone.normalization." + index + ".";
    const int outputs = spec.backbone().convolutions(layer).channels();
    const int stride = spec.backbone().convolutions(layer).stride();
    const int out_height = (height - 1) / stride + 1;
    const int out_width = (width - 1) / stride + 1;
    Values y(static_cast<size_t>(outputs * out_height * out_width));
    for (int o = 0; o < outputs; ++o) {
      const size_t oc = static_cast<size_t>(o);
      for (int row = 0; row < out_height; ++row) {
        for (int column = 0; column < out_width; ++column) {
          double sum = 0;
          for (int c = 0; c < channels; ++c) {
            for (int dy = -1; dy <= 1; ++dy) {
              for (int dx = -1; dx <= 1; ++dx) {
                const int sy = row * stride + dy, sx = column * stride + dx;
                if (sy < 0 || sy >= height || sx < 0 || sx >= width) continue;
                sum += double{weight[static_cast<size_t>(((o * channels + c) * 3 + dy + 1) * 3 +
                                                         dx + 1)]} *
                       x[static_cast<size_t>((c * height + sy) * width + sx)];
              }
            }
          }
          const double normalized = (sum - Tensor(normalization + "running_mean")[oc]) /
                                    std::sqrt(Tensor(normalization + "running_var")[oc] + 1e-5);
          y[static_cast<size_t>((o * out_height + row) * out_width + column)] =
              std::max(0.0, normalized * Tensor(normalization + "weight")[oc] +
                                Tensor(normalization + "bias")[oc]);
        }
      }
    }
    x = std::move(y);
    channels = outputs;
    height = out_height;
    width = out_width;
  }
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

ReferenceModel::Values ReferenceModel::Probabilities(const Values& features) const {
  Values logits = Mlp("action_predictor",
                      model_.manifest.spec().action_predictor().hidden_size() + 1, features);
  long double sum = 0;
  for (const double logit : logits) sum += std::exp(static_cast<long double>(logit));
  for (double& logit : logits) {
    logit = static_cast<double>(std::exp(static_cast<long double>(logit)) / sum);
  }
  return logits;
}

ReferenceModel::Values ReferenceModel::Posterior(const Values& features, int k) const {
  const v1::ModelSpec& spec = model_.manifest.spec();
  const size_t D = static_cast<size_t>(spec.latent_dimensions());
  Values output = Mlp("scenario_encoder", spec.scenario_encoder().hidden_size() + 1, features, k);
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

ReferenceModel::Values ReferenceModel::Responsibilities(const Values& features,
                                                        const Values& x) const {
  const v1::ModelSpec& spec = model_.manifest.spec();
  const size_t K = static_cast<size_t>(spec.actions());
  const size_t D = static_cast<size_t>(spec.latent_dimensions());
  const Values prior = Probabilities(features);
  const Values q = EncodeTrajectory(x);
  std::vector<long double> joint(K);
  long double sum = 0;
  for (size_t k = 0; k < K; ++k) {
    const Values posterior = Posterior(features, static_cast<int>(k));
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

}  // namespace maneuver::inference
