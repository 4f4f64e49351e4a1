#include "model/learning/calibration.h"

#include <ATen/ops/rand.h>
#include <ATen/ops/randn.h>
#include <gtest/gtest.h>

#include <cmath>

#include "model/artifact/model_cost.h"
#include "model/artifact/training_presets.h"
#include "model/learning/covariance_fit.h"
#include "model/learning/moments.h"

namespace maneuver::learning::calibration_test {
namespace {

// Predictions of two actions whose residuals have known covariances.
Predictions KnownPredictions(at::Generator& generator, double scale) {
  constexpr int64_t kExamples = 4000;
  Predictions predictions;
  predictions.mean = at::zeros({kExamples, 2, 1, 2}, at::kFloat);
  predictions.mean.select(1, 1).fill_(100.0);
  predictions.covariance = at::zeros({kExamples, 2, 1, 3}, at::kFloat);
  predictions.log_probabilities = at::full({kExamples, 2}, std::log(0.5), at::kFloat);
  predictions.log_responsibilities = at::full({kExamples, 2}, -50.0, at::kFloat);
  at::Tensor x = at::empty({kExamples, 2}, at::kFloat).normal_(0.0, 1.0, generator);
  x.select(1, 0).mul_(2.0 * scale);  // deviations of 2 m along and 0.5 m across
  x.select(1, 1).mul_(0.5 * scale);
  x.slice(0, kExamples / 2).add_(100.0);
  predictions.log_responsibilities.slice(0, 0, kExamples / 2).select(1, 0).zero_();
  predictions.log_responsibilities.slice(0, kExamples / 2).select(1, 1).zero_();
  predictions.trajectories = x;
  return predictions;
}

TEST(CalibrationTest, DecoderCovarianceIsThatOfTheResiduals) {
  at::Generator generator = MakeGenerator(1);
  const Predictions predictions = KnownPredictions(generator, 1.0);
  const at::Tensor covariance = FitDecoderCovariance(predictions, generator);
  for (int k = 0; k < 2; ++k) {
    EXPECT_NEAR(covariance[k][0][0].item<double>(), 4.0, 0.4);
    EXPECT_NEAR(covariance[k][0][1].item<double>(), 0.0, 0.1);
    EXPECT_NEAR(covariance[k][0][2].item<double>(), 0.25, 0.025);
  }
}

TEST(CalibrationTest, DoesNotCountTheLatentCovarianceTwice) {
  at::Generator generator = MakeGenerator(1);
  Predictions predictions = KnownPredictions(generator, 1.0);
  predictions.covariance.select(3, 0).fill_(3.0);
  const at::Tensor covariance = FitDecoderCovariance(predictions, generator);
  EXPECT_NEAR(covariance[0][0][0].item<double>(), 1.0, 0.4);
}

TEST(CalibrationTest, CovarianceScaleFollowsHeldOutResiduals) {
  at::Generator generator = MakeGenerator(1);
  const Predictions training = KnownPredictions(generator, 1.0);
  const at::Tensor covariance = FitDecoderCovariance(training, generator);
  const CovarianceScale scale =
      FitCovarianceScale(KnownPredictions(generator, 1.5), covariance, /*fit_latent=*/false);
  EXPECT_NEAR(scale.factor[0].item<double>(), 2.25, 0.2);
  EXPECT_EQ(scale.latent_stddev, 1.0);
}

// Errors as wide as the latent says times `width`, of latents whose widths differ.
Predictions SpreadPredictions(at::Generator& generator, double width) {
  Predictions predictions = KnownPredictions(generator, 1.0);
  const int64_t examples = predictions.trajectories.size(0);
  const at::Tensor stddev = at::rand({examples, 1}, generator) * 3.0 + 0.3;
  const at::Tensor error = at::randn({examples, 2}, generator) * stddev * width;
  predictions.trajectories = error;
  predictions.trajectories.slice(0, examples / 2).add_(100.0);
  predictions.covariance.select(3, 0).copy_(stddev.square().view({-1, 1, 1}));
  predictions.covariance.select(3, 2).copy_(stddev.square().view({-1, 1, 1}));
  return predictions;
}

TEST(CalibrationTest, WidensALatentThatIsTooNarrow) {
  at::Generator generator = MakeGenerator(4);
  const at::Tensor little = at::tensor({0.01, 0.0, 0.01}, at::kFloat).view({1, 1, 3});
  for (const double width : {0.6, 1.0, 1.7}) {
    const CovarianceScale scale = FitCovarianceScale(SpreadPredictions(generator, width),
                                                     little.expand({2, 1, 3}), /*fit_latent=*/true);
    EXPECT_NEAR(scale.latent_stddev, width, 0.05 * width);
  }
}

TEST(CalibrationTest, AGaussianHasTheTheoreticalCoverage) {
  at::Generator generator = MakeGenerator(5);
  const Predictions predictions = KnownPredictions(generator, 1.0);
  const at::Tensor covariance =
      at::tensor({4.0, 0.0, 0.25}, at::kFloat).view({1, 1, 3}).expand({2, 1, 3});
  EXPECT_NEAR(CoveredShare(predictions, covariance), 1.0 - std::exp(-2.0), 0.015);
  EXPECT_NEAR(CoveredShare(predictions, 0.25 * covariance), 1.0 - std::exp(-0.5), 0.02);
}

TEST(CalibrationTest, WideningCoversHeavyTailsAndNarrowsNothing) {
  at::Generator generator = MakeGenerator(6);
  Predictions predictions = KnownPredictions(generator, 1.0);
  // One in four errs four times as far.
  at::Tensor far = at::arange(4000).remainder(4).eq(0).to(at::kFloat) * 3.0 + 1.0;
  const at::Tensor center = predictions.mean.select(3, 0).select(2, 0);
  const at::Tensor own = (predictions.log_responsibilities.exp() * center).sum(1, true);
  predictions.trajectories = (predictions.trajectories - own) * far.unsqueeze(1) + own;
  const at::Tensor covariance =
      at::tensor({4.0, 0.0, 0.25}, at::kFloat).view({1, 1, 3}).expand({2, 1, 3});
  const double before = CoveredShare(predictions, covariance);
  EXPECT_LT(before, 0.8);
  const double factor = WidenToCover(predictions, covariance, 0.865);
  EXPECT_GT(factor, 1.0);
  EXPECT_NEAR(CoveredShare(predictions, factor * covariance), 0.865, 1e-3);
  EXPECT_LT(CoveredShare(predictions, 0.99 * factor * covariance), 0.865);
  EXPECT_EQ(WidenToCover(predictions, covariance, before - 0.01), 1.0);
  EXPECT_EQ(WidenToCover(predictions, covariance, 0.0), 1.0);
}

TEST(CalibrationTest, GradientsOfBatchesHaveTheBitsOfAllExamplesAtOnce) {
  at::Generator generator = MakeGenerator(8);
  constexpr int64_t kExamples = 150, kActions = 5, kWaypoints = 7;
  Predictions predictions;
  predictions.trajectories = at::randn({kExamples, 2 * kWaypoints}, generator);
  predictions.log_probabilities = at::log_softmax(at::randn({kExamples, kActions}, generator), 1);
  predictions.mean = at::randn({kExamples, kActions, kWaypoints, 2}, generator);
  at::Tensor covariance = at::rand({kExamples, kActions, kWaypoints, 3}, generator);
  covariance.select(3, 0).add_(1.5);
  covariance.select(3, 2).add_(1.5);
  const at::Tensor whole = covariance.clone().set_requires_grad(true);
  (-WaypointLogLikelihood(predictions.log_probabilities, predictions.mean, whole,
                          predictions.trajectories)
        .mean())
      .backward();
  EXPECT_TRUE(NllGradient(predictions, covariance).equal(whole.grad()));
}

TEST(CalibrationTest, FewerExamplesWhereTheirPredictionsWouldExceedTheMemory) {
  const v1::ModelSpec spec = artifact::ResolveTrainingSettings(v1::TrainingSettings()).model();
  const CalibrationExamples all = artifact::CalibrationExamplesIn(spec, int64_t{2} << 30);
  EXPECT_EQ(all.training, 4096);
  EXPECT_EQ(all.held_out, 3072);
  const int64_t memory = 64'000'000;
  const CalibrationExamples few = artifact::CalibrationExamplesIn(spec, memory);
  EXPECT_NEAR(static_cast<double>((few.training + few.held_out) * artifact::PredictionBytes(spec)),
              memory / 4.0, artifact::PredictionBytes(spec));
  EXPECT_EQ(artifact::CalibrationExamplesIn(spec, 0).held_out, kFewestHeldOut);
}

// Two actions, of which the likelier one is right with log-odds 1 and predicted with log-odds
// `predicted`. A trajectory tells its action by log-likelihood ratios of +-2, give or take 2, which
// is what such ratios do that are normal: their variance is twice their mean.
TEST(CalibrationTest, TheTemperatureIsTheMostLikelyOneWhereTrajectoriesTellLittle) {
  constexpr int64_t kDraws = 40'000;
  at::Generator generator = MakeGenerator(1);
  const auto log_odds = [](const at::Tensor& odds) {  // of the first action, [N] -> [N, 2]
    return at::log_softmax(at::stack({odds, at::zeros_like(odds)}, 1), 1);
  };
  const at::Tensor likelier =
      at::empty({kDraws}, at::kFloat).bernoulli_(0.5, generator) * 2.0 - 1.0;
  const at::Tensor right =
      at::empty({kDraws}, at::kFloat).bernoulli_(1.0 / (1.0 + std::exp(-1.0)), generator) * 2.0 -
      1.0;
  const at::Tensor ratio =
      2.0 * likelier * right + at::empty({kDraws}, at::kFloat).normal_(0.0, 2.0, generator);
  for (const double predicted : {3.0, 1.0, 0.5}) {
    const at::Tensor log_p = log_odds(predicted * likelier);
    const at::Tensor log_q = log_odds(predicted * likelier + ratio);
    EXPECT_NEAR(FitTemperature(log_p, log_q), predicted, 0.07 * predicted);
  }
}

// Anchors have one-hot q(y|x,s): then the temperature is that of a classifier.
TEST(CalibrationTest, TheTemperatureOfKnownActionsUndoesOverconfidence) {
  at::Generator generator = MakeGenerator(1);
  const at::Tensor logits = at::randn({20'000, 5}, generator) * 1.5;
  const at::Tensor actions =
      at::softmax(logits, 1).multinomial(1, /*replacement=*/true, generator).squeeze(1);
  const at::Tensor log_q = at::one_hot(actions, 5).log();  // 0 and -inf
  EXPECT_NEAR(FitTemperature(at::log_softmax(2.0 * logits, 1), log_q), 2.0, 0.06);
  EXPECT_NEAR(FitTemperature(at::log_softmax(logits, 1), log_q), 1.0, 0.03);
}

TEST(MomentsTest, WaypointLogLikelihoodIsThatOfAMixtureOfGaussians) {
  const at::Tensor log_p = at::tensor({0.3, 0.7}, at::kDouble).log().view({1, 2});
  const at::Tensor mean = at::tensor({0.0, 0.0, 2.0, 1.0}, at::kDouble).view({1, 2, 1, 2});
  const at::Tensor covariance =
      at::tensor({1.0, 0.0, 4.0, 2.0, 0.5, 1.0}, at::kDouble).view({1, 2, 1, 3});
  const at::Tensor x = at::tensor({1.0, 0.5}, at::kDouble).view({1, 2});
  // N((1, .5); 0, diag(1, 4)) and N((-1, -.5); 0, [2 .5; .5 1]), determinant 1.75.
  const double first = std::exp(-0.5 * (1.0 + 0.25 / 4.0)) / (2.0 * M_PI * 2.0);
  const double quadratic = (1.0 * 1.0 - 2.0 * 0.5 * 0.5 + 2.0 * 0.25) / 1.75;
  const double second = std::exp(-0.5 * quadratic) / (2.0 * M_PI * std::sqrt(1.75));
  EXPECT_NEAR(WaypointLogLikelihood(log_p, mean, covariance, x).item<double>(),
              std::log(0.3 * first + 0.7 * second), 1e-12);
}

}  // namespace
}  // namespace maneuver::learning::calibration_test
