// The objective's terms against the plain C++ of model/probability, Monte Carlo and finite
// differences.

#include "model/learning/objectives.h"

#include <ATen/ops/allclose.h>
#include <ATen/ops/equal.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "model/learning/networks.h"
#include "model/probability/diagonal_gaussian.h"
#include "model/probability/responsibilities.h"
#include "tests/unit/model/probability/log_density.h"

namespace maneuver::learning::objectives_test {
namespace {

constexpr int64_t kBatch = 4;
constexpr int64_t kActions = 5;
constexpr int64_t kLatents = 3;
constexpr int64_t kCoordinates = 6;

Eigen::VectorXd ToEigen(const at::Tensor& values) {
  const at::Tensor copy = values.detach().to(at::kDouble).contiguous();
  return Eigen::Map<const Eigen::VectorXd>(copy.data_ptr<double>(), copy.numel());
}

probability::DiagonalGaussian Plain(const Gaussian& gaussian, int64_t i) {
  return {ToEigen(gaussian.mean[i]), ToEigen(gaussian.log_variance[i])};
}

// A small model in double precision with a linear decoder, x = z A.
class ObjectivesTest : public testing::Test {
 protected:
  ObjectivesTest() {
    at::Generator generator = MakeGenerator(3);
    const auto normal = [&](at::IntArrayRef shape) {
      return at::empty(shape, at::kDouble).normal_(0.0, 1.0, generator);
    };
    encoding_ = {normal({kBatch, kLatents}), 0.5 * normal({kBatch, kLatents}) - 1.0};
    mixture_ = {normal({kActions, kLatents}), 0.5 * normal({kActions, kLatents})};
    posterior_ = {normal({kBatch, kActions, kLatents}),
                  0.5 * normal({kBatch, kActions, kLatents}) - 1.0};
    log_p_y_ = at::log_softmax(normal({kBatch, kActions}), 1);
    decoder_ = normal({kLatents, kCoordinates});
    trajectories_ = normal({kBatch, kCoordinates});
    noise_ = normal({kBatch, kLatents});
    posterior_noise_ = normal({kBatch, kActions, kLatents});
  }

  at::Tensor Decode(const at::Tensor& z) const { return at::matmul(z, decoder_); }

  BaseModel Base() const {
    return {trajectories_, Decode(Sample(encoding_, noise_)), encoding_, mixture_, log_p_y_,
            kStddev};
  }
  PosteriorBranch Posterior() const {
    return {Decode(Sample(posterior_, posterior_noise_)), posterior_};
  }

  static constexpr double kStddev = 0.7;
  Gaussian encoding_, mixture_, posterior_;
  at::Tensor log_p_y_, decoder_, trajectories_, noise_, posterior_noise_;
};

TEST_F(ObjectivesTest, TermsOfTheUnifiedBoundMatchThePlainFunctions) {
  const BoundTerms terms = UnifiedBound(Base(), Posterior());
  const probability::LatentMixture mixture{
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.mean.data_ptr<double>(), kActions, kLatents),
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.log_variance.data_ptr<double>(), kActions, kLatents),
      Eigen::VectorXd::Zero(kActions)};
  for (int64_t i = 0; i < kBatch; ++i) {
    const probability::DiagonalGaussian q_z = Plain(encoding_, i);
    std::vector<probability::DiagonalGaussian> posteriors;
    for (int64_t k = 0; k < kActions; ++k) {
      posteriors.push_back(
          {ToEigen(posterior_.mean[i][k]), ToEigen(posterior_.log_variance[i][k])});
    }
    const Eigen::VectorXd log_p_y = ToEigen(log_p_y_[i]);
    const Eigen::VectorXd q_y =
        probability::UnifiedResponsibilities(log_p_y, q_z, mixture, posteriors);
    double action = 0.0, latent = 0.0, posterior = 0.0, reconstruction = 0.0;
    for (int k = 0; k < kActions; ++k) {
      EXPECT_NEAR(terms.log_responsibilities[i][k].item<double>(), std::log(q_y[k]), 1e-9);
      action += q_y[k] * (std::log(q_y[k]) - log_p_y[k]);
      latent += q_y[k] * probability::KlDivergence(q_z, mixture.Component(k));
      posterior += q_y[k] * probability::KlDivergence(posteriors[k], mixture.Component(k));
      const Eigen::VectorXd error = ToEigen(trajectories_[i]) - ToEigen(Posterior().decoded[i][k]);
      reconstruction +=
          q_y[k] * (-0.5 * error.squaredNorm() / (kStddev * kStddev) -
                    0.5 * kCoordinates * std::log(2.0 * std::numbers::pi * kStddev * kStddev));
    }
    EXPECT_NEAR(terms.action_divergence[i].item<double>(), action, 1e-9);
    EXPECT_NEAR(terms.latent_divergence[i].item<double>(), latent, 1e-9);
    EXPECT_NEAR(terms.posterior_divergence[i].item<double>(), posterior, 1e-9);
    EXPECT_NEAR(terms.posterior_reconstruction[i].item<double>(), reconstruction, 1e-8);
  }
}

TEST_F(ObjectivesTest, BaseResponsibilitiesMatchThePlainOnesDespiteUnderflow) {
  encoding_.mean.mul_(100.0);
  const probability::LatentMixture mixture{
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.mean.data_ptr<double>(), kActions, kLatents),
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.log_variance.data_ptr<double>(), kActions, kLatents),
      Eigen::VectorXd::Zero(kActions)};
  const at::Tensor q_y = BaseBound(Base()).log_responsibilities.exp();
  for (int64_t i = 0; i < kBatch; ++i) {
    const Eigen::VectorXd expected =
        probability::BaseResponsibilities(ToEigen(log_p_y_[i]), Plain(encoding_, i), mixture);
    EXPECT_NEAR((ToEigen(q_y[i]) - expected).norm(), 0.0, 1e-9);
    EXPECT_NEAR(q_y[i].sum().item<double>(), 1.0, 1e-12);
  }
}

TEST_F(ObjectivesTest, AHeldActionCostsItsUnheldResponsibility) {
  const probability::LatentMixture mixture{
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.mean.data_ptr<double>(), kActions, kLatents),
      Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
          mixture_.log_variance.data_ptr<double>(), kActions, kLatents),
      Eigen::VectorXd::Zero(kActions)};
  mixture_.mean.set_requires_grad(true);
  BaseModel model = Base();
  model.labels = at::tensor({4, 0, 2, 2}, at::kLong);
  const at::Tensor cost = HeldCrossEntropy(model);
  for (int64_t i = 0; i < kBatch; ++i) {
    const Eigen::VectorXd q_y =
        probability::BaseResponsibilities(ToEigen(log_p_y_[i]), Plain(encoding_, i), mixture);
    EXPECT_NEAR(cost[i].item<double>(), -std::log(q_y[model.labels[i].item<int64_t>()]), 1e-9);
  }
  // d cost / d mean_k = -([k is held] - q_k) (m - mean_k) / variance_k, m the encoding's mean.
  cost[1].backward();
  const Eigen::VectorXd q_y =
      probability::BaseResponsibilities(ToEigen(log_p_y_[1]), Plain(encoding_, 1), mixture);
  for (int64_t k = 0; k < kActions; ++k) {
    const Eigen::VectorXd pull = (ToEigen(encoding_.mean[1]) - ToEigen(mixture_.mean[k])).array() /
                                 ToEigen(mixture_.log_variance[k]).array().exp();
    const Eigen::VectorXd expected = -((k == 0 ? 1.0 : 0.0) - q_y[k]) * pull;
    EXPECT_NEAR((ToEigen(mixture_.mean.grad()[k]) - expected).norm(), 0.0, 1e-9) << k;
  }
}

// L = E_q ln p(x, y, z | s) - ln q(y, z | x, s), by drawing y and z.
TEST_F(ObjectivesTest, BaseBoundIsTheMonteCarloMeanOfLogPOverQ) {
  constexpr int kSamples = 40'000;
  const BoundTerms terms = BaseBound(Base());
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>> decoder(
      decoder_.data_ptr<double>(), kLatents, kCoordinates);
  for (int64_t i = 0; i < 2; ++i) {
    const probability::DiagonalGaussian q_z = Plain(encoding_, i);
    const Eigen::VectorXd q_y = ToEigen(terms.log_responsibilities[i]).array().exp();
    const Eigen::VectorXd log_p_y = ToEigen(log_p_y_[i]);
    const Eigen::VectorXd x = ToEigen(trajectories_[i]);
    std::discrete_distribution<int> draw_y(q_y.data(), q_y.data() + kActions);
    double sum = 0.0, square = 0.0, reconstruction = 0.0;
    for (int sample = 0; sample < kSamples; ++sample) {
      Eigen::VectorXd z(kLatents);
      for (double& value : z) value = normal(random);
      z = q_z.mean.array() + q_z.stddev().array() * z.array();
      const int y = draw_y(random);
      const Eigen::VectorXd error = x - decoder.transpose() * z;
      const double log_p_x =
          -0.5 * error.squaredNorm() / (kStddev * kStddev) -
          0.5 * kCoordinates * std::log(2.0 * std::numbers::pi * kStddev * kStddev);
      const double value = log_p_x + log_p_y[y] + probability::LogDensity(Plain(mixture_, y), z) -
                           std::log(q_y[y]) - probability::LogDensity(q_z, z);
      sum += value;
      square += value * value;
      reconstruction += log_p_x;
    }
    const double mean = sum / kSamples;
    const double error = std::sqrt((square / kSamples - mean * mean) / kSamples);
    // The reconstruction is itself one sample in the objective: its mean stands in for it here.
    const double bound = reconstruction / kSamples - terms.action_divergence[i].item<double>() -
                         terms.latent_divergence[i].item<double>();
    EXPECT_NEAR(bound, mean, 5.0 * error);
  }
}

TEST_F(ObjectivesTest, ResponsibilitiesHaveNoGradient) {
  for (at::Tensor* each : {&encoding_.mean, &mixture_.mean, &log_p_y_, &posterior_.mean}) {
    each->set_requires_grad(true);
  }
  EXPECT_FALSE(BaseBound(Base()).log_responsibilities.requires_grad());
  EXPECT_FALSE(UnifiedBound(Base(), Posterior()).log_responsibilities.requires_grad());
}

// The base bound with gradients through the responsibilities.
at::Tensor BaseLossThroughResponsibilities(const BaseModel& model) {
  const Gaussian q{model.q_z.mean.unsqueeze(1), model.q_z.log_variance.unsqueeze(1)};
  const at::Tensor log_q_y = BaseLogResponsibilities(model.log_p_y, CrossEntropy(q, model.p_z));
  return (ActionDivergence(log_q_y, model.log_p_y) +
          ExpectOverActions(log_q_y, Divergence(q, model.p_z)) -
          LogLikelihood(model.trajectories, model.decoded, model.decoder_stddev))
      .mean();
}

at::Tensor Gradient(at::Tensor* parameter, const std::function<at::Tensor()>& loss) {
  parameter->set_requires_grad(true);
  parameter->mutable_grad().reset();
  loss().backward();
  const at::Tensor gradient = parameter->grad().clone();
  parameter->set_requires_grad(false);
  return gradient;
}

// There q(y|x,s) maximises the bound, so that to first order it does not matter that it is fixed.
TEST_F(ObjectivesTest, BaseGradientIsTheSameThroughTheResponsibilities) {
  for (at::Tensor* parameter : {&mixture_.mean, &mixture_.log_variance, &encoding_.mean,
                                &encoding_.log_variance, &log_p_y_}) {
    const at::Tensor fixed =
        Gradient(parameter, [this] { return Loss(BaseBound(Base()), BoundWeights()); });
    const at::Tensor through =
        Gradient(parameter, [this] { return BaseLossThroughResponsibilities(Base()); });
    EXPECT_LT((fixed - through).norm().item<double>(), 1e-7 * fixed.norm().item<double>());
  }
}

// In the unified model it is not the maximiser: the stop-gradient is part of the definition.
TEST_F(ObjectivesTest, UnifiedGradientTreatsResponsibilitiesAsFixed) {
  const at::Tensor log_q_y = UnifiedBound(Base(), Posterior()).log_responsibilities.detach();
  const auto with_constant = [&] {
    const Gaussian q{encoding_.mean.unsqueeze(1), encoding_.log_variance.unsqueeze(1)};
    const at::Tensor each =
        -LogLikelihood(trajectories_, Base().decoded, kStddev) +
        ActionDivergence(log_q_y, log_p_y_) + ExpectOverActions(log_q_y, Divergence(q, mixture_)) -
        ExpectOverActions(log_q_y,
                          LogLikelihood(trajectories_.unsqueeze(1), Posterior().decoded, kStddev)) +
        ExpectOverActions(log_q_y, Divergence(posterior_, mixture_));
    return each.mean();
  };
  for (at::Tensor* parameter : {&mixture_.mean, &posterior_.mean, &posterior_.log_variance}) {
    const at::Tensor gradient = Gradient(
        parameter, [this] { return Loss(UnifiedBound(Base(), Posterior()), BoundWeights()); });
    EXPECT_LT((gradient - Gradient(parameter, with_constant)).norm().item<double>(), 1e-12);
  }
}

TEST_F(ObjectivesTest, BaseGradientMatchesFiniteDifferences) {
  constexpr double kStep = 1e-5;
  for (at::Tensor* parameter : {&mixture_.mean, &mixture_.log_variance, &encoding_.mean}) {
    const auto loss = [this] { return Loss(BaseBound(Base()), BoundWeights()); };
    const at::Tensor gradient = Gradient(parameter, loss).flatten();
    double* values = parameter->data_ptr<double>();
    for (const int64_t i : {int64_t{0}, parameter->numel() / 2, parameter->numel() - 1}) {
      const double before = values[i];
      values[i] = before + kStep;
      const double above = loss().item<double>();
      values[i] = before - kStep;
      const double below = loss().item<double>();
      values[i] = before;
      EXPECT_NEAR(gradient[i].item<double>(), (above - below) / (2.0 * kStep), 1e-7);
    }
  }
}

// The unified bound of one example as a function of q_y, E ln p(x'|z') for its sample.
at::Tensor BoundUnder(const at::Tensor& q_y, const BaseModel& model,
                      const PosteriorBranch& posterior) {
  const Gaussian q{model.q_z.mean.unsqueeze(1), model.q_z.log_variance.unsqueeze(1)};
  const at::Tensor gain =
      model.log_p_y - Divergence(q, model.p_z) - Divergence(posterior.q_z, model.p_z) +
      LogLikelihood(model.trajectories.unsqueeze(1), posterior.decoded, model.decoder_stddev);
  return (q_y * (gain - q_y.log())).sum(1);
}

TEST_F(ObjectivesTest, ExactResponsibilitiesMaximiseTheUnifiedBoundAndPrintedOnesDoNot) {
  const at::Tensor exact =
      UnifiedBound(Base(), Posterior(), /*exact_weight=*/1.0).log_responsibilities.exp();
  const at::Tensor printed = UnifiedBound(Base(), Posterior()).log_responsibilities.exp();
  const at::Tensor best = BoundUnder(exact, Base(), Posterior());
  EXPECT_TRUE((BoundUnder(printed, Base(), Posterior()) < best).all().item<bool>());
  at::Generator generator = MakeGenerator(9);
  for (int i = 0; i < 20; ++i) {
    const at::Tensor other = at::softmax(
        exact.log() + 0.1 * at::empty({kBatch, kActions}, at::kDouble).normal_(0, 1, generator), 1);
    EXPECT_TRUE((BoundUnder(other, Base(), Posterior()) <= best).all().item<bool>());
  }
}

TEST_F(ObjectivesTest, DualBoundIsTheUnifiedPartUnderBaseResponsibilities) {
  const BoundTerms terms = DualBound(Base(), Posterior());
  EXPECT_FALSE(terms.reconstruction.defined());
  const at::Tensor q_y = BaseBound(Base()).log_responsibilities.exp();
  EXPECT_TRUE(at::allclose(terms.log_responsibilities.exp(), q_y));
  const at::Tensor expected =
      (q_y * (Divergence(posterior_, mixture_) -
              LogLikelihood(trajectories_.unsqueeze(1), Posterior().decoded, kStddev)))
          .sum(1)
          .mean();
  EXPECT_NEAR(Loss(terms, {}).item<double>(), expected.item<double>(), 1e-9);
}

TEST_F(ObjectivesTest, ALabelledExampleHasTheResponsibilityOfItsLabel) {
  BaseModel model = Base();
  const BoundTerms unlabelled = UnifiedBound(model, Posterior());
  model.labels = at::tensor({-1, 2, -1, 0}, at::kLong);
  const BoundTerms terms = UnifiedBound(model, Posterior());
  const at::Tensor q_y = terms.log_responsibilities.exp();
  for (const int64_t i : {0, 2}) {
    EXPECT_TRUE(at::equal(terms.log_responsibilities[i], unlabelled.log_responsibilities[i]));
  }
  EXPECT_EQ(q_y[1][2].item<double>(), 1.0);
  EXPECT_EQ(q_y[1].sum().item<double>(), 1.0);
  EXPECT_EQ(q_y[3][0].item<double>(), 1.0);
  // KL(one-hot || p_y) = -ln p_y of the label.
  EXPECT_NEAR(terms.action_divergence[1].item<double>(), -log_p_y_[1][2].item<double>(), 1e-12);
  EXPECT_TRUE(std::isfinite(Loss(terms, {}).item<double>()));
}

TEST_F(ObjectivesTest, LossWeightsItsTerms) {
  const BoundTerms terms = UnifiedBound(Base(), Posterior());
  const double loss = Loss(terms, {5.0, 0.05, 2.0, 0.5}).item<double>();
  const double expected =
      (-terms.reconstruction + 5.0 * terms.action_divergence + 0.5 * terms.latent_divergence -
       0.05 * terms.posterior_reconstruction + 2.0 * terms.posterior_divergence)
          .mean()
          .item<double>();
  EXPECT_NEAR(loss, expected, 1e-12);
}

}  // namespace
}  // namespace maneuver::learning::objectives_test
