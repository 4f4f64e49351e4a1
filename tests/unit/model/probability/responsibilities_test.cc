#include "model/probability/responsibilities.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "model/probability/sigma_points.h"
#include "tests/unit/model/probability/log_density.h"
#include "tests/unit/model/probability/quadrature.h"

namespace maneuver::probability::responsibilities_test {
namespace {

// Three actions over a plane of latents, and a trajectory's encoding among them.
class ResponsibilitiesTest : public testing::Test {
 protected:
  ResponsibilitiesTest() {
    mixture_.mean.resize(3, 2);
    mixture_.mean << -1, 0, 1, 0.5, 0.2, -1.5;
    mixture_.log_variance.resize(3, 2);
    mixture_.log_variance << -0.5, 0.1, 0.3, -1, 0, 0.4;
    mixture_.log_weight = LogSoftmax(Eigen::Vector3d::Zero());
    log_prior_ = LogSoftmax(Eigen::Vector3d(0.5, -0.3, 0.1));
    encoding_ = {Eigen::Vector2d(0.3, -0.4), Eigen::Vector2d(-1.5, -0.7)};
    posteriors_ = {{Eigen::Vector2d(-0.8, 0.3), Eigen::Vector2d(-1, -1)},
                   {Eigen::Vector2d(1.2, 0.1), Eigen::Vector2d(-2, -1.5)},
                   {Eigen::Vector2d(1.0, -1.0), Eigen::Vector2d(0.2, -0.5)}};
  }

  // Returns E_q ln p of Gaussians over the plane, summed over a grid.
  static double ExpectedLogOnGrid(const DiagonalGaussian& q, const DiagonalGaussian& p) {
    const auto q_at = [&](double z, int d) {
      return NormalDensity(z, q.mean[d], std::exp(q.log_variance[d]));
    };
    const auto p_at = [&](double z, int d) {
      return NormalDensity(z, p.mean[d], std::exp(p.log_variance[d]));
    };
    return Integrate(
        [&](double u) {
          return Integrate(
              [&](double v) { return q_at(u, 0) * q_at(v, 1) * std::log(p_at(u, 0) * p_at(v, 1)); },
              -10, 10, 400);
        },
        -10, 10, 400);
  }

  static Eigen::VectorXd Normalize(const std::vector<double>& values) {
    const Eigen::VectorXd vector = Eigen::Map<const Eigen::VectorXd>(values.data(), 3);
    return vector / vector.sum();
  }

  LatentMixture mixture_;
  Eigen::VectorXd log_prior_;
  DiagonalGaussian encoding_;
  std::vector<DiagonalGaussian> posteriors_;
};

TEST_F(ResponsibilitiesTest, BaseFormMatchesBruteForceOverAGrid) {
  std::vector<double> joint;
  for (int k = 0; k < 3; ++k) {
    joint.push_back(std::exp(log_prior_[k]) *
                    std::exp(ExpectedLogOnGrid(encoding_, mixture_.Component(k))));
  }
  const Eigen::VectorXd expected = Normalize(joint);
  const Eigen::VectorXd actual = BaseResponsibilities(log_prior_, encoding_, mixture_);
  EXPECT_LT((actual - expected).cwiseAbs().maxCoeff(), 1e-8) << actual.transpose();
}

TEST_F(ResponsibilitiesTest, UnifiedFormMatchesBruteForceOverAGrid) {
  std::vector<double> joint;
  for (int k = 0; k < 3; ++k) {
    const DiagonalGaussian& posterior = posteriors_[static_cast<size_t>(k)];
    const double minus_divergence = ExpectedLogOnGrid(posterior, mixture_.Component(k)) -
                                    ExpectedLogOnGrid(posterior, posterior);
    joint.push_back(
        std::exp(log_prior_[k]) *
        std::exp(ExpectedLogOnGrid(encoding_, mixture_.Component(k)) + minus_divergence));
  }
  const Eigen::VectorXd expected = Normalize(joint);
  const Eigen::VectorXd actual =
      UnifiedResponsibilities(log_prior_, encoding_, mixture_, posteriors_);
  EXPECT_LT((actual - expected).cwiseAbs().maxCoeff(), 1e-8) << actual.transpose();
}

TEST_F(ResponsibilitiesTest, FormsAgreeWhenTheScenarioTellsNothingAboutTheLatent) {
  const std::vector<DiagonalGaussian> generic = {mixture_.Component(0), mixture_.Component(1),
                                                 mixture_.Component(2)};
  EXPECT_LT((UnifiedResponsibilities(log_prior_, encoding_, mixture_, generic) -
             BaseResponsibilities(log_prior_, encoding_, mixture_))
                .norm(),
            1e-12);
}

TEST_F(ResponsibilitiesTest, NormalisesEvidenceThatUnderflows) {
  const DiagonalGaussian far = {Eigen::Vector2d(300, -400), Eigen::Vector2d(0, 0)};
  const Eigen::VectorXd responsibilities = BaseResponsibilities(log_prior_, far, mixture_);
  EXPECT_NEAR(responsibilities.sum(), 1.0, 1e-12);
  EXPECT_TRUE(responsibilities.allFinite());
}

TEST_F(ResponsibilitiesTest, AnImpossibleActionHasNoResponsibility) {
  log_prior_[1] = -INFINITY;
  const Eigen::VectorXd responsibilities = BaseResponsibilities(log_prior_, encoding_, mixture_);
  EXPECT_EQ(responsibilities[1], 0.0);
  EXPECT_NEAR(responsibilities.sum(), 1.0, 1e-12);
}

// Returns eq. (elbo) at any q_y, term by term.
double Bound(double reconstruction, const Eigen::VectorXd& q_y, const Eigen::VectorXd& log_prior,
             const DiagonalGaussian& encoding, const LatentMixture& mixture) {
  double bound = reconstruction;
  for (int k = 0; k < 3; ++k) {
    bound -= q_y[k] * (std::log(q_y[k]) - log_prior[k]);
    bound -= q_y[k] * KlDivergence(encoding, mixture.Component(k));
  }
  return bound;
}

TEST_F(ResponsibilitiesTest, TheBoundIsTheElboAndTheBaseFormMaximisesIt) {
  const Eigen::VectorXd best = BaseResponsibilities(log_prior_, encoding_, mixture_);
  const double bound = BaseBound(-12.5, log_prior_, encoding_, mixture_);
  EXPECT_NEAR(bound, Bound(-12.5, best, log_prior_, encoding_, mixture_), 1e-12);
  for (int k = 0; k < 3; ++k) {
    for (const double change : {-0.3, 0.3}) {
      Eigen::Vector3d logits = best.array().log();
      logits[k] += change;
      EXPECT_LT(Bound(-12.5, Softmax(logits), log_prior_, encoding_, mixture_), bound);
    }
  }
}

// With a linear decoder the bound is known exactly: a Monte Carlo estimate of E_q ln p(x,y,z|s) /
// q(y,z|x,s). It must not exceed ln p(x|s).
TEST_F(ResponsibilitiesTest, TheBoundMatchesMonteCarloAndStaysBelowTheLikelihood) {
  Eigen::Matrix<double, 4, 2> A;
  A << 1, 0.5, -0.3, 2, 0.7, 0.1, 0, -1;
  const Eigen::Vector4d x(0.5, -0.2, 0.3, 0.8);
  const double stddev = 0.9;
  const Eigen::MatrixXd points = SigmaPoints(encoding_.mean, encoding_.stddev());
  SigmaMoments moments;
  MomentsOfSigmaPoints(points * A.transpose(), &moments);
  const double bound =
      BaseBound(ExpectedLogDensity(x, moments, stddev), log_prior_, encoding_, mixture_);

  const auto log_likelihood = [&](const Eigen::Vector2d& z) {
    double sum = 0;
    for (int i = 0; i < 4; ++i) {
      sum += std::log(NormalDensity(x[i], A.row(i).dot(z), stddev * stddev));
    }
    return sum;
  };
  const Eigen::VectorXd q_y = BaseResponsibilities(log_prior_, encoding_, mixture_);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const Eigen::Vector2d deviation = encoding_.stddev();
  const int samples = 200'000;
  double sum = 0, sum_of_squares = 0;
  for (int i = 0; i < samples; ++i) {
    const Eigen::Vector2d z =
        encoding_.mean + deviation.cwiseProduct(Eigen::Vector2d(normal(random), normal(random)));
    double term = log_likelihood(z) - LogDensity(encoding_, z);
    for (int k = 0; k < 3; ++k) {
      term += q_y[k] * (log_prior_[k] + LogDensity(mixture_.Component(k), z) - std::log(q_y[k]));
    }
    sum += term;
    sum_of_squares += term * term;
  }
  const double mean = sum / samples;
  const double standard_error = std::sqrt((sum_of_squares / samples - mean * mean) / samples);
  EXPECT_NEAR(bound, mean, 4 * standard_error);
  EXPECT_LT(standard_error, 0.02);

  const double likelihood = Integrate(
      [&](double u) {
        return Integrate(
            [&](double v) {
              const Eigen::Vector2d z(u, v);
              double prior = 0;
              for (int k = 0; k < 3; ++k) {
                prior += std::exp(log_prior_[k] + LogDensity(mixture_.Component(k), z));
              }
              return prior * std::exp(log_likelihood(z));
            },
            -8, 8, 200);
      },
      -8, 8, 200);
  EXPECT_LT(bound, std::log(likelihood));
}

}  // namespace
}  // namespace maneuver::probability::responsibilities_test
