#include "model/learning/calibration.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/covariance_network.h"
#include "model/learning/predictions.h"
#include "model/learning/speed_factors.h"

namespace maneuver::learning {
namespace {

std::string LastLayer(const char* network, const v1::MlpSpec& spec) {
  return network + ("." + std::to_string(spec.hidden_size()));
}

// Whether the covariance of p(x|z) is fitted to training examples.
bool FitsToTraining(const v1::ModelSpec& spec, const v1::OptimizationSettings& optimization) {
  return optimization.decoder_covariance() != v1::DECODER_COVARIANCE_FIXED &&
         !spec.has_scene_covariance();
}

// Whether the width of q(z|y,s) is fitted. In a base model it is p(z|y) and stays so.
bool FitsLatent(const v1::ModelSpec& spec, const v1::OptimizationSettings& optimization) {
  return FitsToTraining(spec, optimization) && optimization.calibrate_latent() &&
         spec.objective() != v1::OBJECTIVE_BASE;
}

// The covariance of p(x|z) for each example, or for all.
at::Tensor DecoderCovariance(const Networks& networks, const Predictions& predictions) {
  at::NoGradGuard no_grad;
  return networks.spec().has_decoder_covariance() ? networks.PredictCovariance(predictions.latents)
                                                  : networks["decoder.covariance"];
}

// factor: [T]
void ScaleDecoderCovariance(Networks& networks, const at::Tensor& factor) {
  at::NoGradGuard no_grad;
  if (networks.spec().has_decoder_covariance()) {
    ScaleCovarianceNetwork(networks, factor);
  } else {
    networks["decoder.covariance"].mul_(factor.view({1, -1, 1}));
  }
}

void FitCovariance(Networks& networks, const Predictions& training, at::Generator& generator) {
  if (networks.spec().has_decoder_covariance()) {
    FitCovarianceNetwork(networks, training, PooledCovariance(training), generator);
    return;
  }
  const at::Tensor covariance = FitDecoderCovariance(training, generator);
  at::NoGradGuard no_grad;
  networks["decoder.covariance"].copy_(covariance);
}

// Multiplies the standard deviations of q(z|y,s).
void ScaleLatent(Networks& networks, double factor) {
  at::NoGradGuard no_grad;
  at::Tensor bias = networks[LastLayer("scenario_encoder", networks.spec().scenario_encoder()) +
                             ".bias"];  // [K, 2D]: a, then b of the log-variance
  bias.slice(1, bias.size(1) / 2).add_(2.0 * std::log(factor));
}

void ScaleLogits(Networks& networks, double temperature) {
  at::NoGradGuard no_grad;
  if (networks.spec().has_action_geometry()) {
    networks["action_geometry.logit.weight"].div_(temperature);
  }
  const std::string last = LastLayer("action_predictor", networks.spec().action_predictor());
  networks[last + ".weight"].div_(temperature);
  networks[last + ".bias"].div_(temperature);
}

// Gives predictions the temperature that their networks have now. What a trajectory tells of its
// action, q(y|x,s) / p(y|s), stays.
void SetTemperature(double temperature, Predictions& predictions) {
  const at::Tensor before = predictions.log_probabilities;
  predictions.log_probabilities = at::log_softmax(before / temperature, 1);
  at::Tensor& log_q = predictions.log_responsibilities;
  if (log_q.defined()) log_q = at::log_softmax(log_q - before + predictions.log_probabilities, 1);
}

// Fits the temperature of p(y|s). Returns it.
double CalibrateProbabilities(Networks& networks, Predictions& held_out) {
  const double temperature =
      FitTemperature(held_out.log_probabilities, held_out.log_responsibilities);
  ScaleLogits(networks, temperature);
  SetTemperature(temperature, held_out);
  return temperature;
}

// Fits the factors of a covariance that the scene predicts.
void CalibrateBySpeed(Networks& networks, const Predictions& held_out, double covered_share) {
  at::Tensor factors = FitSpeedFactors(held_out);
  if (covered_share > 0.0) factors = ScaleToCoverBySpeed(held_out, factors, covered_share);
  at::NoGradGuard no_grad;
  networks["scene_covariance.speed_factor"].copy_(factors);
}

// Scales any other covariance.
void CalibrateAlongHorizon(Networks& networks, const Predictions& held_out, double covered_share) {
  at::Tensor covariance = DecoderCovariance(networks, held_out);
  at::Tensor factor = FitCovarianceScale(held_out, covariance, /*fit_latent=*/false).factor;
  covariance = covariance * factor.view({1, -1, 1});
  factor = factor * WidenToCover(held_out, covariance, covered_share);
  ScaleDecoderCovariance(networks, factor);
}

}  // namespace

double FitTemperature(const at::Tensor& log_probabilities, const at::Tensor& log_responsibilities) {
  const at::Tensor log_p = log_probabilities.to(at::kDouble);
  // v. It is -inf where q is 0, as in the one-hot q of anchors.
  const at::Tensor evidence = log_responsibilities.to(at::kDouble) - log_p;
  const auto loss = [&](double log_temperature) {
    const at::Tensor tempered = at::log_softmax(log_p * std::exp(-log_temperature), 1);
    return -at::logsumexp(tempered + evidence, 1).mean().item<double>();
  };
  // It may have several minima. The least of a few steps, from T = 1 on:
  constexpr double kStep = 0.25 * std::numbers::ln2;
  constexpr int kSteps = 8;  // to 4 and to 1/4
  double middle = 0.0;
  double least = loss(middle);
  for (int i = 1; i <= kSteps; ++i) {
    for (const double there : {i * kStep, -i * kStep}) {
      const double value = loss(there);
      if (value < least) {
        least = value;
        middle = there;
      }
    }
  }
  // And around it golden-section search.
  constexpr double kGolden = 0.6180339887498949;
  double low = std::max(middle - kStep, -kSteps * kStep);
  double high = std::min(middle + kStep, kSteps * kStep);
  for (int i = 0; i < 25; ++i) {
    const double a = high - kGolden * (high - low);
    const double b = low + kGolden * (high - low);
    if (loss(a) < loss(b)) {
      high = b;
    } else {
      low = a;
    }
  }
  return std::exp(0.5 * (low + high));
}

absl::Status CalibrateModel(Networks& networks, const SceneSource& training_source,
                            const SceneSource& held_out_source, const CalibrationExamples& most,
                            const v1::OptimizationSettings& optimization, int threads,
                            at::Generator& generator, const std::function<bool()>& stopped,
                            const CountCalibrationStep& count) {
  const auto stop = [] { return absl::CancelledError("training was stopped"); };
  const ExampleFeatures training_examples =
      EncodeExamples(networks, training_source, most.training, threads, stopped, count);
  if (stopped()) return stop();
  const ExampleFeatures held_out_examples =
      EncodeExamples(networks, held_out_source, most.held_out, threads, stopped, count);
  if (stopped()) return stop();
  const bool has_held_out =
      held_out_examples.trajectories.defined() && held_out_examples.scenes.size() >= kFewestHeldOut;
  const bool fixed = optimization.decoder_covariance() == v1::DECODER_COVARIANCE_FIXED;

  // Otherwise only p(y|s) of the training examples is needed.
  Predictions training;
  if (FitsToTraining(networks.spec(), optimization)) {
    training = Predict(networks, training_examples);
  } else {
    training.log_probabilities = PredictLogProbabilities(networks, training_examples);
  }
  Predictions held_out = has_held_out ? Predict(networks, held_out_examples) : Predictions();
  // How wide q(z|y,s) is, first: q(y|x,s) depends on it, and everything else on that.
  if (has_held_out && FitsLatent(networks.spec(), optimization)) {
    FitCovariance(networks, training, generator);
    if (stopped()) return stop();
    const CovarianceScale scale =
        FitCovarianceScale(held_out, DecoderCovariance(networks, held_out), /*fit_latent=*/true);
    ScaleLatent(networks, scale.latent_stddev);
    training = held_out = {};  // frees their memory first
    training = Predict(networks, training_examples);
    held_out = Predict(networks, held_out_examples);
  }
  if (has_held_out && optimization.calibrate_probabilities()) {
    const double temperature = CalibrateProbabilities(networks, held_out);
    SetTemperature(temperature, training);
  }
  if (fixed) {
    at::NoGradGuard no_grad;
    const double variance = std::pow(networks.spec().decoder_stddev(), 2.0);
    networks["decoder.covariance"].copy_(at::tensor({variance, 0.0, variance}, at::kFloat));
  } else if (networks.spec().has_scene_covariance()) {
    if (has_held_out) CalibrateBySpeed(networks, held_out, optimization.covered_share());
  } else {
    FitCovariance(networks, training, generator);
    if (stopped()) return stop();
    if (has_held_out) CalibrateAlongHorizon(networks, held_out, optimization.covered_share());
  }

  at::NoGradGuard no_grad;
  networks["mixture.log_weight"].copy_(
      training.log_probabilities.exp().mean(0).clamp_min(1e-9).log());
  return absl::OkStatus();
}

absl::Status RecalibrateModel(Networks& networks, const SceneSource& examples, int64_t most,
                              double covered_share, int threads,
                              const std::function<bool()>& stopped,
                              const CountCalibrationStep& count) {
  const auto stop = [] { return absl::CancelledError("the recalibration was stopped"); };
  const auto found = static_cast<int64_t>(examples.set().examples.size());
  if (std::min(found, most) < kFewestHeldOut) {
    return absl::FailedPreconditionError(
        absl::StrCat("recalibration needs ", kFewestHeldOut, " examples to fit to, and there are ",
                     found, "; collect more outcomes, or make examples.stride smaller"));
  }
  const ExampleFeatures features =
      EncodeExamples(networks, examples, most, threads, stopped, count);
  if (stopped()) return stop();
  Predictions predictions = Predict(networks, features);
  if (stopped()) return stop();
  CalibrateProbabilities(networks, predictions);
  if (networks.spec().has_scene_covariance()) {
    CalibrateBySpeed(networks, predictions, covered_share);
  } else {
    CalibrateAlongHorizon(networks, predictions, covered_share);
  }
  return absl::OkStatus();
}

CalibrationPlan PlanRecalibration(const v1::ModelSpec& spec, int64_t examples) {
  const auto batches = [examples](int64_t batch) { return (examples + batch - 1) / batch; };
  CalibrationPlan plan;
  const auto planned = [&plan](CalibrationStep kind) -> PlannedSteps& {
    return plan[static_cast<size_t>(kind)];
  };
  planned(CalibrationStep::kEncode) = {batches(kEncodedBatch), kEncodedBatch};
  planned(CalibrationStep::kPredict) = {batches(kPredictedBatch), kPredictedBatch};
  if (spec.has_scene_covariance()) {
    planned(CalibrationStep::kFit) = SpeedFactorSteps(examples);
  } else {
    planned(CalibrationStep::kScale) = CovarianceScaleSteps(examples);
  }
  return plan;
}

CalibrationPlan PlanCalibration(const v1::TrainingSettings& settings,
                                const CalibrationExamples& examples) {
  const v1::ModelSpec& spec = settings.model();
  const v1::OptimizationSettings& optimization = settings.optimization();
  const bool has_held_out = examples.held_out >= kFewestHeldOut;
  const int64_t times = has_held_out && FitsLatent(spec, optimization) ? 2 : 1;
  const auto batches = [](int64_t count, int64_t batch) { return (count + batch - 1) / batch; };
  CalibrationPlan plan;
  const auto planned = [&plan](CalibrationStep kind) -> PlannedSteps& {
    return plan[static_cast<size_t>(kind)];
  };
  planned(CalibrationStep::kEncode) = {
      batches(examples.training, kEncodedBatch) + batches(examples.held_out, kEncodedBatch),
      kEncodedBatch};
  PlannedSteps& predict = planned(CalibrationStep::kPredict);
  predict.examples = kPredictedBatch;
  if (has_held_out) predict.count += times * batches(examples.held_out, kPredictedBatch);
  if (FitsToTraining(spec, optimization)) {
    predict.count += times * batches(examples.training, kPredictedBatch);
    PlannedSteps& fit = planned(CalibrationStep::kFit);
    fit = spec.has_decoder_covariance() ? CovarianceNetworkSteps(examples.training)
                                        : DecoderCovarianceSteps(examples.training);
    fit.count *= times;
    if (has_held_out) {
      PlannedSteps& scale = planned(CalibrationStep::kScale);
      scale = CovarianceScaleSteps(examples.held_out);
      scale.count *= times;
    }
  } else if (spec.has_scene_covariance() && has_held_out &&
             optimization.decoder_covariance() != v1::DECODER_COVARIANCE_FIXED) {
    planned(CalibrationStep::kFit) = SpeedFactorSteps(examples.held_out);
  }
  return plan;
}

}  // namespace maneuver::learning
