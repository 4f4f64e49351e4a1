#include "model/learning/speed_factors.h"

#include "model/artifact/tensor.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/optimizer.h"

namespace maneuver::learning {
namespace {

constexpr int kFactorSteps = 60;
constexpr double kFactorRate = 0.1;
// Weight, in examples, of the prior that pulls a bin's factors towards those of the other bins.
// Examples of one recording are alike: 300 are worth about a dozen recordings.
constexpr double kPriorExamples = 300.0;
// How many examples it takes to scale a part of the bins by itself.
constexpr int64_t kFewestInPart = 100;

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
    held_out.CountStep(CalibrationStep::kFit);
  }
  return logs.exp().detach();
}

PlannedSteps SpeedFactorSteps(int64_t examples) { return {kFactorSteps, examples}; }

at::Tensor ScaleToCoverBySpeed(const Predictions& held_out, const at::Tensor& factors,
                               double share) {
  at::NoGradGuard no_grad;
  const Predictions own = OfOwnAction(held_out);
  const at::Tensor covariance = WithSpeedFactors(own, factors);
  const at::Tensor stands = SpeedBins(held_out.speeds) == 0;
  const auto number = [&](const at::Tensor& part) {
    const at::Tensor rows = part.nonzero().flatten();
    return rows.size(0) < kFewestInPart
               ? ScaleToCover(own, covariance, share)
               : ScaleToCover(own.Rows(rows), covariance.index_select(0, rows), share);
  };
  at::Tensor scaled = factors * number(~stands);
  scaled[0] = factors[0] * number(stands);
  return scaled;
}

}  // namespace maneuver::learning
