#include "model/learning/covariance_network.h"

#include <ATen/ops/rand.h>
#include <ATen/ops/randn.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::covariance_network_test {
namespace {

v1::ModelSpec PredictedSpec() {
  v1::ModelSpec spec = TinySettings().model();
  spec.mutable_decoder_covariance()->add_hidden(16);
  return spec;
}

// Errors whose deviation is e^z along the way and half as much across it, under two actions of
// which each example is the first.
struct Errors {
  Predictions predictions;
  at::Tensor z;  // [N]
};

Errors DrawErrors(const v1::ModelSpec& spec, int64_t examples, at::Generator& generator) {
  const int64_t T = spec.trajectory().waypoints();
  const int64_t D = spec.latent_dimensions();
  Errors drawn;
  drawn.z = at::rand({examples}, generator) * 2.0 - 1.0;
  at::Tensor error = at::randn({examples, T, 2}, generator);
  error *= drawn.z.exp().view({-1, 1, 1});
  error.select(2, 1) *= 0.5;
  Predictions& predictions = drawn.predictions;
  predictions.trajectories = error.reshape({examples, 2 * T});
  predictions.mean = at::zeros({examples, 2, T, 2});
  predictions.covariance = at::zeros({examples, 2, T, 3});
  predictions.log_probabilities = at::full({examples, 2}, std::log(0.5));
  predictions.log_responsibilities = at::tensor({0.0, -100.0}, at::kFloat).expand({examples, 2});
  predictions.latents = at::zeros({examples, 2, D});
  predictions.latents.select(1, 0).select(1, 0).copy_(drawn.z);
  return drawn;
}

TEST(CovarianceNetworkTest, LearnsHowWideTheErrorsOfALatentAre) {
  const v1::ModelSpec spec = PredictedSpec();
  at::Generator generator = MakeGenerator(2);
  Networks networks(spec, at::kCPU, generator);
  const Errors drawn = DrawErrors(spec, 4000, generator);
  FitCovarianceNetwork(networks, drawn.predictions,
                       at::tensor({1.0, 0.0, 1.0}).expand({spec.trajectory().waypoints(), 3}),
                       generator);
  at::NoGradGuard no_grad;
  at::Tensor latent = at::zeros({spec.latent_dimensions()});
  for (const double z : {-0.7, 0.0, 0.7}) {
    latent[0] = z;
    const at::Tensor covariance = networks.PredictCovariance(latent);  // [T, 3]
    ASSERT_EQ(covariance.sizes(), at::IntArrayRef({spec.trajectory().waypoints(), 3}));
    const at::Tensor mean = covariance.mean(0);
    const double along = std::exp(2.0 * z);
    EXPECT_NEAR(mean[0].item<double>(), along, 0.15 * along) << z;
    EXPECT_NEAR(mean[1].item<double>(), 0.0, 0.1 * along) << z;
    EXPECT_NEAR(mean[2].item<double>(), along / 4, 0.15 * along / 4) << z;
  }
}

TEST(CovarianceNetworkTest, AddsNothingIfTheLatentSpreadsEnough) {
  const v1::ModelSpec spec = PredictedSpec();
  at::Generator generator = MakeGenerator(2);
  Networks networks(spec, at::kCPU, generator);
  Errors drawn = DrawErrors(spec, 4000, generator);
  const at::Tensor variance = (2.0 * drawn.z).exp().view({-1, 1, 1});
  drawn.predictions.covariance.select(3, 0).copy_(variance);
  drawn.predictions.covariance.select(3, 2).copy_(0.25 * variance);
  FitCovarianceNetwork(networks, drawn.predictions,
                       at::tensor({1.0, 0.0, 1.0}).expand({spec.trajectory().waypoints(), 3}),
                       generator);
  at::NoGradGuard no_grad;
  const at::Tensor covariance = networks.PredictCovariance(at::zeros({spec.latent_dimensions()}));
  EXPECT_LT(covariance.select(1, 0).mean().item<double>(), 0.08);
  EXPECT_LT(covariance.select(1, 2).mean().item<double>(), 0.02);
}

TEST(CovarianceNetworkTest, IsScaledWaypointByWaypoint) {
  const v1::ModelSpec spec = PredictedSpec();
  at::Generator generator = MakeGenerator(3);
  Networks networks(spec, at::kCPU, generator);
  const int64_t T = spec.trajectory().waypoints();
  at::NoGradGuard no_grad;
  const at::Tensor latents = 0.2 * at::randn({4, 2, spec.latent_dimensions()}, generator);
  const at::Tensor before = networks.PredictCovariance(latents);
  const at::Tensor factor = at::linspace(0.5, 2.0, T);
  ScaleCovarianceNetwork(networks, factor);
  const at::Tensor after = networks.PredictCovariance(latents);
  EXPECT_TRUE(after.allclose(before * factor.view({T, 1}), 1e-4, 1e-6));
}

}  // namespace
}  // namespace maneuver::learning::covariance_network_test
