#include "model/learning/calibration.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/covariance_network.h"
#include "model/learning/predictions.h"
#include "model/learning/speed_factors.h"

namespace maneuver::learning {
namespace {

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
  at::Tensor bias =
      networks[artifact::LastLayer("scenario_encoder", networks.spec().scenario_encoder()) +
               ".bias"];  // [K, 2D]: a, then b of the log-variance
  bias.slice(1, bias.size(1) / 2).add_(2.0 * std::log(factor));
}

void ScaleLogits(Networks& networks, double temperature) {
  at::NoGradGuard no_grad;
  if (networks.spec().has_action_geometry()) {
    networks["action_geometry.logit.weight"].div_(temperature);
  }
  const std::string last =
      artifact::LastLayer("action_predictor", networks.spec().action_predictor());
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

// Calibrates a model step by step. Each step needs those before it.
class Calibration {
 public:
  Calibration(Networks& networks, const v1::OptimizationSettings& optimization,
              const CalibrationRun& run)
      : networks_(networks), spec_(networks.spec()), optimization_(optimization), run_(run) {}

  absl::Status Run(const SceneSource& training, const SceneSource& held_out) {
    if (!Encode(training, held_out)) return Stopped();
    Predict();
    // How wide q(z|y,s) is, first: q(y|x,s) depends on it, and everything else on that.
    if (has_held_out_ && FitsLatent(spec_, optimization_) && !FitLatentWidth()) return Stopped();
    if (has_held_out_ && optimization_.calibrate_probabilities()) {
      SetTemperature(CalibrateProbabilities(networks_, held_out_), training_);
    }
    if (!CalibrateCovariance()) return Stopped();
    SetMixtureWeights();
    return absl::OkStatus();
  }

 private:
  static absl::Status Stopped() { return absl::CancelledError("training was stopped"); }

  // Returns false if the run is stopped, as the functions below.
  bool Encode(const SceneSource& training, const SceneSource& held_out) {
    training_examples_ = EncodeExamples(networks_, training, run_.most.training, run_.threads,
                                        run_.stopped, run_.count);
    if (run_.stopped()) return false;
    held_out_examples_ = EncodeExamples(networks_, held_out, run_.most.held_out, run_.threads,
                                        run_.stopped, run_.count);
    has_held_out_ = held_out_examples_.trajectories.defined() &&
                    held_out_examples_.scenes.size() >= kFewestHeldOut;
    return !run_.stopped();
  }

  void Predict() {
    if (FitsToTraining(spec_, optimization_)) {
      training_ = learning::Predict(networks_, training_examples_);
    } else {  // only p(y|s) is needed
      training_.log_probabilities = PredictLogProbabilities(networks_, training_examples_);
    }
    if (has_held_out_) held_out_ = learning::Predict(networks_, held_out_examples_);
  }

  bool FitLatentWidth() {
    FitCovariance(networks_, training_, run_.generator);
    if (run_.stopped()) return false;
    const CovarianceScale scale =
        FitCovarianceScale(held_out_, DecoderCovariance(networks_, held_out_), /*fit_latent=*/true);
    ScaleLatent(networks_, scale.latent_stddev);
    training_ = held_out_ = {};  // frees their memory first
    Predict();
    return true;
  }

  bool CalibrateCovariance() {
    if (optimization_.decoder_covariance() == v1::DECODER_COVARIANCE_FIXED) {
      at::NoGradGuard no_grad;
      const double variance = std::pow(spec_.decoder_stddev(), 2.0);
      networks_["decoder.covariance"].copy_(at::tensor({variance, 0.0, variance}, at::kFloat));
    } else if (spec_.has_scene_covariance()) {
      if (has_held_out_) CalibrateBySpeed(networks_, held_out_, optimization_.covered_share());
    } else {
      FitCovariance(networks_, training_, run_.generator);
      if (run_.stopped()) return false;
      if (has_held_out_) {
        CalibrateAlongHorizon(networks_, held_out_, optimization_.covered_share());
      }
    }
    return true;
  }

  void SetMixtureWeights() {
    at::NoGradGuard no_grad;
    networks_["mixture.log_weight"].copy_(
        training_.log_probabilities.exp().mean(0).clamp_min(1e-9).log());
  }

  Networks& networks_;
  const v1::ModelSpec& spec_;
  const v1::OptimizationSettings& optimization_;
  const CalibrationRun& run_;
  ExampleFeatures training_examples_;
  ExampleFeatures held_out_examples_;
  bool has_held_out_ = false;
  Predictions training_;
  Predictions held_out_;
};

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

absl::Status CalibrateModel(Networks& networks, const SceneSource& training,
                            const SceneSource& held_out,
                            const v1::OptimizationSettings& optimization,
                            const CalibrationRun& run) {
  return Calibration(networks, optimization, run).Run(training, held_out);
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
  CalibrationPlan plan;
  StepsOfKind(plan, CalibrationStep::kEncode) = {BatchesOf(examples, kEncodedBatch), kEncodedBatch};
  StepsOfKind(plan, CalibrationStep::kPredict) = {BatchesOf(examples, kPredictedBatch),
                                                  kPredictedBatch};
  if (spec.has_scene_covariance()) {
    StepsOfKind(plan, CalibrationStep::kFit) = SpeedFactorSteps(examples);
  } else {
    StepsOfKind(plan, CalibrationStep::kScale) = CovarianceScaleSteps(examples);
  }
  return plan;
}

CalibrationPlan PlanCalibration(const v1::TrainingSettings& settings,
                                const CalibrationExamples& examples) {
  const v1::ModelSpec& spec = settings.model();
  const v1::OptimizationSettings& optimization = settings.optimization();
  const bool has_held_out = examples.held_out >= kFewestHeldOut;
  const int64_t times = has_held_out && FitsLatent(spec, optimization) ? 2 : 1;
  CalibrationPlan plan;
  StepsOfKind(plan, CalibrationStep::kEncode) = {
      BatchesOf(examples.training, kEncodedBatch) + BatchesOf(examples.held_out, kEncodedBatch),
      kEncodedBatch};
  PlannedSteps& predict = StepsOfKind(plan, CalibrationStep::kPredict);
  predict.examples = kPredictedBatch;
  if (has_held_out) predict.count += times * BatchesOf(examples.held_out, kPredictedBatch);
  if (FitsToTraining(spec, optimization)) {
    predict.count += times * BatchesOf(examples.training, kPredictedBatch);
    PlannedSteps& fit = StepsOfKind(plan, CalibrationStep::kFit);
    fit = spec.has_decoder_covariance() ? CovarianceNetworkSteps(examples.training)
                                        : DecoderCovarianceSteps(examples.training);
    fit.count *= times;
    if (has_held_out) {
      PlannedSteps& scale = StepsOfKind(plan, CalibrationStep::kScale);
      scale = CovarianceScaleSteps(examples.held_out);
      scale.count *= times;
    }
  } else if (spec.has_scene_covariance() && has_held_out &&
             optimization.decoder_covariance() != v1::DECODER_COVARIANCE_FIXED) {
    StepsOfKind(plan, CalibrationStep::kFit) = SpeedFactorSteps(examples.held_out);
  }
  return plan;
}

}  // namespace maneuver::learning
