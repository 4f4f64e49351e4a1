#include "model/learning/calibration.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "model/learning/moments.h"
#include "model/learning/objectives.h"
#include "model/learning/optimizer.h"
#include "model/learning/scene_bound.h"
#include "model/learning/validation.h"

namespace maneuver::learning {
namespace {

constexpr int64_t kMostTraining = 4096;  // examples
constexpr int64_t kMostHeldOut = 3072;
constexpr int64_t kFewestHeldOut = 100;  // below this nothing is fitted to them
constexpr int64_t kBatch = 64;
constexpr double kFloor = 0.05;  // metres: no covariance is narrower
constexpr int kFitPasses = 8;
constexpr int64_t kFitBatch = 512;
constexpr double kFitRate = 0.05;
constexpr int kScaleSteps = 80;

// [.., 3] lower Cholesky factor (l11, l21, l22), the diagonal as logarithms, to xx, xy, yy.
at::Tensor CovarianceOf(const at::Tensor& factor) {
  const at::Tensor l11 = factor.select(-1, 0).exp();
  const at::Tensor l21 = factor.select(-1, 1);
  const at::Tensor l22 = factor.select(-1, 2).exp();
  return at::stack(
      {l11.square() + kFloor * kFloor, l11 * l21, l21.square() + l22.square() + kFloor * kFloor},
      -1);
}

// Its inverse, for covariances at least twice the floor wide.
at::Tensor FactorOf(const at::Tensor& covariance) {
  const at::Tensor xx = (covariance.select(-1, 0) - kFloor * kFloor).clamp_min(kFloor * kFloor);
  const at::Tensor l11 = xx.sqrt();
  const at::Tensor l21 = covariance.select(-1, 1) / l11;
  const at::Tensor rest =
      (covariance.select(-1, 2) - kFloor * kFloor - l21.square()).clamp_min(kFloor * kFloor);
  return at::stack({l11.log(), l21, 0.5 * rest.log()}, -1);
}

// sum_i q_k (e e^T - latent) / sum_i q_k, with some of the mean over all actions mixed in where an
// action has few examples. [K, T, 3]
at::Tensor ResidualCovariance(const Predictions& predictions) {
  constexpr double kPriorExamples = 20.0;
  const at::Tensor weight = predictions.log_responsibilities.exp();  // [N, K]
  const at::Tensor truth =
      predictions.trajectories.view({predictions.trajectories.size(0), 1, -1, 2});
  const at::Tensor error = truth - predictions.mean;
  const at::Tensor dx = error.select(3, 0);
  const at::Tensor dy = error.select(3, 1);
  const at::Tensor unexplained =
      at::stack({dx.square(), dx * dy, dy.square()}, -1) - predictions.covariance;
  const at::Tensor sums = (weight.unsqueeze(-1).unsqueeze(-1) * unexplained).sum(0);  // [K, T, 3]
  const at::Tensor counts = weight.sum(0).view({-1, 1, 1});
  const at::Tensor pooled = sums.sum(0, /*keepdim=*/true) / counts.sum();
  return (sums + kPriorExamples * pooled) / (counts + kPriorExamples);
}

// -E ln p over waypoints.
at::Tensor Nll(const Predictions& predictions, const at::Tensor& own_covariance) {
  return -WaypointLogLikelihood(predictions.log_probabilities, predictions.mean,
                                predictions.covariance + own_covariance, predictions.trajectories)
              .mean();
}

Predictions Rows(const Predictions& predictions, const at::Tensor& rows) {
  return {predictions.trajectories.index_select(0, rows),
          predictions.log_probabilities.index_select(0, rows),
          predictions.log_responsibilities.index_select(0, rows),
          predictions.mean.index_select(0, rows), predictions.covariance.index_select(0, rows)};
}

}  // namespace

Predictions Predict(Networks& networks, const ExampleSet& set, int64_t most, int threads,
                    const std::function<bool()>& stopped,
                    const std::function<void(int64_t)>& step) {
  at::NoGradGuard no_grad;
  const v1::ModelSpec& spec = networks.spec();
  std::vector<at::Tensor> trajectories, log_p, log_q, means, covariances;
  RasterLoader loader(spec.raster(), set, DrawItems(set, most), kBatch, threads);
  while (std::optional<RasterLoader::Batch> batch = loader.Next()) {
    if (stopped()) break;
    const at::Tensor x = VariedTrajectories(set, *batch).to(networks.device());
    const at::Tensor features =
        networks.EncodeScenes(RasterTensor(spec.raster(), *batch), VariedMotions(set, *batch), {});
    const at::Tensor log_p_y = networks.PredictActions(features);
    const Gaussian posterior = networks.EncodeScenarios(features);
    const WaypointMoments moments = LatentMoments(networks, posterior);
    trajectories.push_back(x);
    log_p.push_back(log_p_y);
    log_q.push_back(Responsibilities(networks, {x, features, {}}, log_p_y, posterior));
    means.push_back(moments.mean);
    covariances.push_back(moments.covariance);
    step(x.size(0));
  }
  if (trajectories.empty()) return {};
  return {at::cat(trajectories), at::cat(log_p), at::cat(log_q), at::cat(means),
          at::cat(covariances)};
}

at::Tensor FitDecoderCovariance(const Predictions& predictions, at::Generator& generator) {
  at::Tensor factor = FactorOf(ResidualCovariance(predictions)).detach().contiguous();
  factor.set_requires_grad(true);
  const int64_t examples = predictions.trajectories.size(0);
  const int64_t batches = (examples + kFitBatch - 1) / kFitBatch;
  AdamW optimizer;
  optimizer.Add({factor}, kFitRate, 0.0);
  for (int64_t step = 0; step < kFitPasses * batches; ++step) {
    const at::Tensor rows =
        at::randint(examples, {std::min(examples, kFitBatch)}, generator, at::kLong)
            .to(factor.device());
    Nll(Rows(predictions, rows), CovarianceOf(factor)).backward();
    optimizer.Step(LearningRateShare(step, 0, kFitPasses * batches));
  }
  return CovarianceOf(factor).detach();
}

at::Tensor FitCovarianceScale(const Predictions& held_out, const at::Tensor& covariance) {
  // Under p(y|s) neighbouring actions would cover for one that is too narrow.
  Predictions own_actions = held_out;
  own_actions.log_probabilities = held_out.log_responsibilities;
  const int64_t waypoints = covariance.size(-2);
  const at::Tensor along = at::linspace(0.0, 1.0, waypoints, covariance.options());
  // ln of the factor at the start, and how much more it is at the end of the horizon.
  at::Tensor line = at::zeros({2}, covariance.options());
  line.set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({line}, 0.1, 0.0);
  const auto factor = [&] { return (line[0] + line[1] * along).exp(); };
  for (int step = 0; step < kScaleSteps; ++step) {
    Nll(own_actions, covariance * factor().view({1, -1, 1})).backward();
    optimizer.Step(LearningRateShare(step, 0, kScaleSteps));
  }
  return factor().detach();
}

double FitTemperature(const at::Tensor& log_probabilities, const at::Tensor& log_responsibilities) {
  const at::Tensor q = log_responsibilities.exp();
  const auto cross_entropy = [&](double log_temperature) {
    return -(q * at::log_softmax(log_probabilities * std::exp(-log_temperature), 1))
                .sum(1)
                .mean()
                .item<double>();
  };
  // It has one minimum in the inverse temperature: golden-section search.
  constexpr double kGolden = 0.6180339887498949;
  double low = std::log(0.25), high = std::log(4.0);
  for (int i = 0; i < 30; ++i) {
    const double a = high - kGolden * (high - low);
    const double b = low + kGolden * (high - low);
    (cross_entropy(a) < cross_entropy(b) ? high : low) =
        cross_entropy(a) < cross_entropy(b) ? b : a;
  }
  return std::exp(0.5 * (low + high));
}

absl::Status CalibrateModel(Networks& networks, const TrainingData& data,
                            const v1::OptimizationSettings& optimization, int threads,
                            at::Generator& generator, const std::function<bool()>& stopped,
                            const std::function<void(int64_t)>& step) {
  const auto stop = [] { return absl::CancelledError("training was stopped"); };
  Predictions training = Predict(networks, data.training, kMostTraining, threads, stopped, step);
  if (stopped()) return stop();
  Predictions held_out = Predict(networks, data.validation, kMostHeldOut, threads, stopped, step);
  if (stopped()) return stop();
  const bool has_held_out =
      held_out.trajectories.defined() && held_out.trajectories.size(0) >= kFewestHeldOut;

  double temperature = 1.0;
  if (has_held_out && optimization.calibrate_probabilities()) {
    temperature = FitTemperature(held_out.log_probabilities, held_out.log_responsibilities);
    for (Predictions* each : {&training, &held_out}) {
      each->log_probabilities = at::log_softmax(each->log_probabilities / temperature, 1);
    }
  }
  at::Tensor covariance;
  if (optimization.decoder_covariance() == v1::DECODER_COVARIANCE_FIXED) {
    const double variance = std::pow(networks.spec().decoder_stddev(), 2.0);
    covariance = at::tensor({variance, 0.0, variance}, at::kFloat);
  } else {
    covariance = FitDecoderCovariance(training, generator);
    if (stopped()) return stop();
    if (has_held_out) {
      covariance = covariance * FitCovarianceScale(held_out, covariance).view({1, -1, 1});
    }
  }

  at::NoGradGuard no_grad;
  const std::string last_layer =
      "action_predictor." + std::to_string(networks.spec().action_predictor().hidden_size());
  networks[last_layer + ".weight"].div_(temperature);
  networks[last_layer + ".bias"].div_(temperature);
  networks["decoder.covariance"].copy_(covariance);
  networks["mixture.log_weight"].copy_(
      training.log_probabilities.exp().mean(0).clamp_min(1e-9).log());
  return absl::OkStatus();
}

int64_t CalibrationSteps(int64_t training_examples) {
  return (std::min(training_examples, kMostTraining) + kBatch - 1) / kBatch;
}

}  // namespace maneuver::learning
