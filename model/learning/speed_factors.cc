#include "model/learning/speed_factors.h"

#include "model/artifact/tensor.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/optimizer.h"

namespace maneuver::learning {
namespace {

constexpr int kFactorSteps = 60;
constexpr double kFactorRate = 0.1;
// How many examples a bin's factors are drawn to the others' by, and how many it takes to widen a
// bin by itself. Examples of one recording are alike: 300 are worth about a dozen recordings.
constexpr double kPriorExamples = 300.0;
constexpr int64_t kFewestInBin = 300;

}  // namespace

at::Tensor SpeedBins(const at::Tensor& speeds) {
  at::Tensor bins = at::zeros(speeds.sizes(), speeds.options().dtype(at::kLong));
  for (const double bound : artifact::kSpeedBins) bins += (speeds.abs() >= bound).to(at::kLong);
  return bins;
}

at::Tensor WithSpeedFactors(const Predictions& predictions, const at::Tensor& factors) {
  const at::Tensor of_example = factors.index_select(0, SpeedBins(predictions.speeds));  // [N, 2]
  return predictions.along * of_example.select(1, 0).view({-1, 1, 1, 1}) +
         predictions.across * of_example.select(1, 1).view({-1, 1, 1, 1});
}

at::Tensor FitSpeedFactors(const Predictions& held_out) {
  const double examples = static_cast<double>(held_out.trajectories.size(0));
  at::Tensor logs = at::zeros({artifact::kSpeedBinCount, 2}, held_out.along.options());
  logs.set_requires_grad(true);
  AdamW optimizer;
  optimizer.Add({logs}, kFactorRate, 0.0);
  for (int step = 0; step < kFactorSteps; ++step) {
    const at::Tensor whole = held_out.covariance + WithSpeedFactors(held_out, logs.exp());
    whole.backward(NllGradient(held_out, whole));
    const at::Tensor spread = (logs - logs.mean(0, /*keepdim=*/true)).square().sum();
    (0.5 * kPriorExamples / examples * spread).backward();
    optimizer.Step(LearningRateShare(step, 0, kFactorSteps));
    held_out.CountFit(held_out.trajectories.size(0));
  }
  return logs.exp().detach();
}

int64_t SpeedFactorSteps(int64_t examples) { return kFactorSteps * FitSteps(examples); }

at::Tensor WidenToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share) {
  at::NoGradGuard no_grad;
  const at::Tensor bins = SpeedBins(held_out.speeds);
  const Predictions own = OfOwnAction(held_out);
  const at::Tensor covariance = WithSpeedFactors(own, factors);
  const double of_all = WidenToCover(own, covariance, share);
  at::Tensor widened = factors.clone();
  for (int64_t bin = 0; bin < artifact::kSpeedBinCount; ++bin) {
    const at::Tensor rows = (bins == bin).nonzero().flatten();
    widened[bin].mul_(rows.size(0) < kFewestInBin
                          ? of_all
                          : WidenToCover(own.Rows(rows), covariance.index_select(0, rows), share));
  }
  return widened;
}

}  // namespace maneuver::learning
