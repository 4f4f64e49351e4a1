#include "model/learning/covariance_fit.h"

#include <algorithm>
#include <cmath>

#include "model/learning/moments.h"
#include "model/learning/optimizer.h"

namespace maneuver::learning {
namespace {

constexpr double kFloor = 0.05;  // metres: no covariance is narrower
constexpr int kFitPasses = 8;
constexpr int64_t kFitBatch = 512;
constexpr int64_t kGradientBatch = 64;  // examples whose intermediate results are in memory
constexpr double kFitRate = 0.05;
constexpr int kScaleSteps = 80;
constexpr double kScaleRate = 0.1;
constexpr double kMostLatentFactor = 3.0;
constexpr double kMostScaling = 16.0;
// These actions hold nearly all of q(y|x,s). With one action alone, a trajectory between two actions
// would count as an outlier and widen every covariance.
constexpr int64_t kOwnActions = 4;

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
  // In one tensor, because it is one of the largest.
  at::Tensor unexplained = at::empty(predictions.covariance.sizes(), error.options());
  unexplained.select(3, 0).copy_(dx).square_();
  unexplained.select(3, 1).copy_(dx).mul_(dy);
  unexplained.select(3, 2).copy_(dy).square_();
  unexplained.sub_(predictions.covariance).mul_(weight.unsqueeze(-1).unsqueeze(-1));
  const at::Tensor sums = unexplained.sum(0);  // [K, T, 3]
  const at::Tensor counts = weight.sum(0).view({-1, 1, 1});
  const at::Tensor pooled = sums.sum(0, /*keepdim=*/true) / counts.sum();
  return (sums + kPriorExamples * pooled) / (counts + kPriorExamples);
}

// Each example under the few actions that it most likely is.
struct OwnActions {
  Predictions predictions;  // of those actions, [N, own, ..], their probabilities q(y|x,s)
  at::Tensor covariance;    // the decoder's, [N, own, T, 3]
};

//   covariance: [K, T, 3] or [N, K, T, 3], or undefined
OwnActions TakeOwnActions(const Predictions& predictions, const at::Tensor& covariance,
                          int64_t own) {
  const auto [log_q, actions] = predictions.log_responsibilities.topk(
      std::min(own, predictions.log_responsibilities.size(1)), 1);  // [N, own]
  const int64_t examples = actions.size(0), count = actions.size(1);
  const auto take = [&, &chosen = actions](const at::Tensor& of_all) {  // [N, K, T, C]
    if (!of_all.defined()) return of_all;
    const at::Tensor index = chosen.view({examples, count, 1, 1})
                                 .expand({examples, count, of_all.size(2), of_all.size(3)});
    return of_all.gather(1, index);
  };
  const at::Tensor log_share = at::log_softmax(log_q, 1);
  return {{predictions.trajectories,
           log_share,
           log_share,
           take(predictions.mean),
           take(predictions.covariance),
           {},
           predictions.speeds,
           take(predictions.along),
           take(predictions.across)},
          !covariance.defined() || covariance.dim() == 4
              ? take(covariance)
              : covariance.index_select(0, actions.reshape({-1}))
                    .view({examples, count, covariance.size(1), covariance.size(2)})};
}

// The share of waypoints within two standard deviations, if the decoder's covariance is `factor`
// times as large.
//   own: of one action
double CoveredShare(const OwnActions& own, double factor) {
  at::NoGradGuard no_grad;
  return (SquaredDistances(own.predictions.mean,
                           own.predictions.covariance + own.covariance * factor,
                           own.predictions.trajectories) <= 4.0)
      .to(at::kFloat)
      .mean()
      .item<double>();
}

}  // namespace

Predictions OfOwnAction(const Predictions& predictions) {
  return TakeOwnActions(predictions, {}, 1).predictions;
}

at::Tensor PooledCovariance(const Predictions& predictions) {
  const at::Tensor weight = predictions.log_responsibilities.exp().sum(0);  // [K]
  return (weight.view({-1, 1, 1}) * ResidualCovariance(predictions)).sum(0) / weight.sum();
}

at::Tensor NllGradient(const Predictions& predictions, const at::Tensor& covariance) {
  const int64_t examples = covariance.size(0);
  const double waypoints = static_cast<double>(examples * covariance.size(2));
  const at::Tensor all = covariance.detach();
  at::Tensor gradient = at::empty(all.sizes(), all.options());
  for (int64_t begin = 0; begin < examples; begin += kGradientBatch) {
    const auto rows = [&](const at::Tensor& of_all) {
      return of_all.slice(0, begin, begin + kGradientBatch);
    };
    const at::Tensor batch = rows(all).detach().set_requires_grad(true);
    const at::Tensor log_likelihood =
        WaypointLogLikelihood(rows(predictions.log_probabilities), rows(predictions.mean), batch,
                              rows(predictions.trajectories));
    log_likelihood.backward(at::full_like(log_likelihood, -1.0).div_(waypoints));
    rows(gradient).copy_(batch.grad());
  }
  return gradient;
}

at::Tensor FitDecoderCovariance(const Predictions& predictions, at::Generator& generator) {
  at::Tensor factor = FactorOf(ResidualCovariance(predictions)).detach().contiguous();
  factor.set_requires_grad(true);
  const int64_t examples = predictions.trajectories.size(0);
  const int64_t batches = BatchesOf(examples, kFitBatch);
  AdamW optimizer;
  optimizer.Add({factor}, kFitRate, 0.0);
  for (int64_t step = 0; step < kFitPasses * batches; ++step) {
    const at::Tensor rows =
        at::randint(examples, {std::min(examples, kFitBatch)}, generator, at::kLong)
            .to(factor.device());
    const Predictions batch = predictions.Rows(rows);
    const at::Tensor whole = batch.covariance + CovarianceOf(factor);
    whole.backward(NllGradient(batch, whole));
    optimizer.Step(LearningRateShare(step, 0, kFitPasses * batches));
    batch.CountStep(CalibrationStep::kFit);
  }
  return CovarianceOf(factor).detach();
}

PlannedSteps DecoderCovarianceSteps(int64_t examples) {
  return {kFitPasses * BatchesOf(examples, kFitBatch), std::min(examples, kFitBatch)};
}

PlannedSteps CovarianceScaleSteps(int64_t examples) { return {kScaleSteps, examples}; }

CovarianceScale FitCovarianceScale(const Predictions& held_out, const at::Tensor& covariance,
                                   bool fit_latent) {
  const OwnActions own = TakeOwnActions(held_out, covariance, kOwnActions);
  const at::Tensor along = at::linspace(0.0, 1.0, covariance.size(-2), covariance.options());
  // ln of the factor at the start, how much more it is at the end of the horizon, and ln of the
  // latent's.
  at::Tensor logs = at::zeros({3}, covariance.options());
  logs.set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({logs}, kScaleRate, 0.0);
  const auto factor = [&] { return (logs[0] + logs[1] * along).exp(); };
  const double most = std::log(kMostLatentFactor);
  const auto latent_factor = [&] { return logs[2].clamp(-most, most).exp(); };
  for (int step = 0; step < kScaleSteps; ++step) {
    at::Tensor whole = own.covariance * factor().view({-1, 1});
    whole = whole + (fit_latent ? own.predictions.covariance * latent_factor().square()
                                : own.predictions.covariance);
    whole.backward(NllGradient(own.predictions, whole));
    optimizer.Step(LearningRateShare(step, 0, kScaleSteps));
    held_out.CountStep(CalibrationStep::kScale);
  }
  return {factor().detach(), fit_latent ? latent_factor().item<double>() : 1.0};
}

double CoveredShare(const Predictions& predictions, const at::Tensor& covariance) {
  return CoveredShare(TakeOwnActions(predictions, covariance, 1), 1.0);
}

double ScaleToCover(const Predictions& held_out, const at::Tensor& covariance, double share) {
  const OwnActions own = TakeOwnActions(held_out, covariance, 1);
  double low = -std::log(kMostScaling), high = std::log(kMostScaling);
  for (int i = 0; i < 20; ++i) {
    const double middle = 0.5 * (low + high);
    (CoveredShare(own, std::exp(middle)) >= share ? high : low) = middle;
  }
  return std::exp(high);
}

double WidenToCover(const Predictions& held_out, const at::Tensor& covariance, double share) {
  if (CoveredShare(held_out, covariance) >= share) return 1.0;
  return ScaleToCover(held_out, covariance, share);
}

}  // namespace maneuver::learning
