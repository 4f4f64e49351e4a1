#include "model/learning/scene_covariance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::scene_covariance_test {
namespace {

TEST(MeanDirectionsTest, DirectionsAreThoseOfTheAveragedSteps) {
  at::Generator generator = MakeGenerator(3);
  constexpr int64_t kWaypoints = 12;
  constexpr double kInterval = 0.1;
  const at::Tensor means =
      at::empty({2, 3, kWaypoints, 2}, at::kFloat).normal_(0.0, 0.2, generator).cumsum(2);
  const at::Tensor u = MeanDirections(means, kInterval);
  for (int64_t b = 0; b < 2; ++b) {
    for (int64_t k = 0; k < 3; ++k) {
      for (int64_t t = 0; t < kWaypoints; ++t) {
        double x = 0.0, y = 0.0;
        int count = 0;
        for (int64_t s = std::max<int64_t>(0, t - 2); s <= std::min(kWaypoints - 1, t + 2); ++s) {
          const auto at = [&](int64_t i, int64_t axis) {
            return i < 0 ? 0.0 : means[b][k][i][axis].item<double>();
          };
          x += at(s, 0) - at(s - 1, 0);
          y += at(s, 1) - at(s - 1, 1);
          ++count;
        }
        const double length = std::hypot(x / count, y / count);
        const bool slow = length <= 0.5 * kInterval;
        EXPECT_NEAR(u[b][k][t][0].item<double>(), slow ? 1.0 : x / count / length, 1e-4);
        EXPECT_NEAR(u[b][k][t][1].item<double>(), slow ? 0.0 : y / count / length, 1e-4);
      }
    }
  }
}

class SceneCovarianceTest : public testing::Test {
 protected:
  SceneCovarianceTest()
      : settings_(TinyLanesSettings()),
        generator_(MakeGenerator(1)),
        networks_(settings_.model(), at::Device(at::kCPU), generator_) {
    const int64_t features = settings_.model().scene_vectors().features();
    const int64_t geometry = settings_.model().action_geometry().features();
    scenes_ = {at::empty({kScenes, features}).normal_(0.0, 1.0, generator_).relu(),
               at::empty({kScenes, 6, geometry}).normal_(0.0, 1.0, generator_).relu()};
    trajectories_ = at::empty({kScenes, 20}).normal_(0.0, 2.0, generator_);
    references_ = at::arange(1, 11).to(at::kFloat).view({1, 10, 1}) *
                  at::tensor({3.0F, 0.5F}).view({1, 1, 2});
    references_ = references_.expand({kScenes, 10, 2}).flatten(1);
  }

  static constexpr int64_t kScenes = 4;
  v1::TrainingSettings settings_;
  at::Generator generator_;
  Networks networks_;
  SceneFeatures scenes_;
  at::Tensor trajectories_;
  at::Tensor references_;
};

TEST_F(SceneCovarianceTest, ItsGradientIsThatOfFiniteDifferences) {
  const auto loss = [this] {
    return SceneCovarianceLoss(networks_, scenes_, trajectories_, references_).mean();
  };
  loss().backward();
  for (const char* name : {"scene_covariance.0.weight", "scene_covariance.1.bias"}) {
    at::Tensor& weight = networks_[name];
    const at::Tensor gradient = weight.grad();
    at::NoGradGuard no_grad;
    for (const int64_t i : {int64_t{0}, weight.numel() / 2, weight.numel() - 1}) {
      at::Tensor one = weight.flatten()[i];
      constexpr double kStep = 1e-2;
      one.add_(kStep);
      const double above = loss().item<double>();
      one.sub_(2.0 * kStep);
      const double below = loss().item<double>();
      one.add_(kStep);
      const double expected = (above - below) / (2.0 * kStep);
      EXPECT_NEAR(gradient.flatten()[i].item<double>(), expected, 2e-3 + 0.02 * std::abs(expected))
          << name << " " << i;
    }
  }
  // Nothing else learns from it.
  EXPECT_FALSE(networks_["decoder.0.weight"].grad().defined());
  EXPECT_FALSE(networks_["scenario_encoder.0.weight"].grad().defined());
}

// A clamp has no gradient outside its bounds, so a deviation that left them could never return.
TEST_F(SceneCovarianceTest, ADeviationOutsideItsBoundsIsOnlyPulledBackTowardsThem) {
  // Zero weights make q(z|x) independent of x, because the encoder cannot handle kilometres.
  for (at::Tensor weight : networks_.Parameters(Networks::Part::kTrajectoryEncoder)) {
    at::NoGradGuard no_grad;
    weight.zero_();
  }
  at::Tensor& bias = networks_["scene_covariance.1.bias"];  // [K, 8], the first of each axis is a_0
  const auto gradient = [&](double log_stddev, const at::Tensor& trajectories) {
    {
      at::NoGradGuard no_grad;
      networks_["scene_covariance.1.weight"].zero_();
      bias.zero_();
      bias.view({-1, 2, 4}).select(2, 0).fill_(log_stddev);
    }
    bias.mutable_grad().reset();
    SceneCovarianceLoss(networks_, scenes_, trajectories, references_).sum().backward();
    return bias.grad().view({-1, 2, 4}).select(2, 0).sum().item<double>();
  };
  EXPECT_LT(gradient(-9.0, trajectories_), -1.0);  // errors of metres at 5 cm: wider
  EXPECT_GT(gradient(9.0, trajectories_), 1.0);    // errors of metres at 55 m: narrower
  // Errors of kilometres at 55 m: no wider.
  EXPECT_EQ(gradient(9.0, at::full_like(trajectories_, 3e3)), 0.0);
}

}  // namespace
}  // namespace maneuver::learning::scene_covariance_test
