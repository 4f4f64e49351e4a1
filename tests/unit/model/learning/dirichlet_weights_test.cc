#include "model/learning/dirichlet_weights.h"

#include <ATen/ops/rand.h>
#include <gmock/gmock.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "model/artifact/model_spec.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "tests/unit/model/learning/analytic_scenes.h"

namespace maneuver::learning::dirichlet_weights_test {
namespace {

// E[ln pi_k] of draws from the Dirichlet, as normalised Gamma variables.
TEST(DirichletWeightsTest, ExpectedLogarithmsMatchRandomDraws) {
  const std::vector<double> counts = {0.5, 2.0, 7.5};
  std::mt19937_64 random(3);
  std::vector<double> sums(3, 0.0);
  constexpr int kDraws = 200'000;
  for (int i = 0; i < kDraws; ++i) {
    std::vector<double> draw;
    double total = 0.0;
    for (const double count : counts) {
      draw.push_back(std::gamma_distribution<double>(count, 1.0)(random));
      total += draw.back();
    }
    for (size_t k = 0; k < 3; ++k) sums[k] += std::log(draw[k] / total);
  }
  const at::Tensor expected = ExpectedLogWeights(at::tensor(counts, at::kDouble));
  for (int64_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(expected[k].item<double>(), sums[static_cast<size_t>(k)] / kDraws, 0.02);
  }
}

TEST(DirichletWeightsTest, CountsConvergeToObservationsPlusPrior) {
  const at::Tensor responsibilities =
      at::tensor({1.0, 0.0, 0.0, 0.5, 0.5, 0.0}, at::kDouble).view({2, 3});
  at::Tensor counts = at::full({3}, 50.0, at::kDouble);
  for (int i = 0; i < 400; ++i) {
    counts = FollowCounts(counts, responsibilities, /*observations=*/200.0, /*concentration=*/0.1,
                          /*rate=*/0.05);
  }
  EXPECT_NEAR(counts[0].item<double>(), 150.1, 1e-3);
  EXPECT_NEAR(counts[1].item<double>(), 50.1, 1e-3);
  EXPECT_NEAR(counts[2].item<double>(), 0.1, 1e-3);
  EXPECT_THAT(UnneededActions(counts, 0.1), testing::ElementsAre(2));
}

// Two components at the same place share their data evenly under maximum likelihood, for ever; the
// sparse prior gives it all to the one that has a little more.
TEST(DirichletWeightsTest, SwitchesOffOneOfTwoEqualActions) {
  constexpr double kConcentration = 1e-3;
  at::Tensor counts = at::tensor({21.0, 19.0, 60.0}, at::kDouble);
  const at::Tensor likelihood =
      at::tensor({0.0, 0.0, -30.0, -30.0, -30.0, 0.0}, at::kDouble).view({2, 3});
  for (int i = 0; i < 4000; ++i) {
    const at::Tensor q = at::softmax(ExpectedLogWeights(counts) + likelihood, 1);
    counts = FollowCounts(counts, q, 100.0, kConcentration, 0.1);
  }
  EXPECT_THAT(UnneededActions(counts, kConcentration), testing::ElementsAre(1));
  EXPECT_NEAR(counts[0].item<double>(), 50.0, 0.1);
  EXPECT_NEAR(counts[2].item<double>(), 50.0, 0.1);
}

TEST(DirichletWeightsTest, TheLargestOfUnneededActionsStays) {
  const at::Tensor counts = at::tensor({5.0, 8.0, 7.0}, at::kDouble);
  EXPECT_THAT(UnneededActions(counts, 10.0), testing::ElementsAre(0, 2));
}

TEST(DirichletWeightsTest, ASwitchedOffActionHasNoProbabilityAndNoGradient) {
  const v1::TrainingSettings settings = TinySettings();
  at::Generator generator = MakeGenerator(1);
  Networks networks(settings.model(), at::kCPU, generator);
  networks.SwitchOff(std::vector<int>{1});
  const int64_t width = artifact::SceneFeatureCount(settings.model());
  const at::Tensor log_p = networks.PredictActions({at::rand({3, width}, generator)});
  EXPECT_EQ(log_p.exp().select(1, 1).max().item<double>(), 0.0);
  EXPECT_TRUE(log_p.isfinite().all().item<bool>());
  EXPECT_NEAR(log_p.exp().sum(1).min().item<double>(), 1.0, 1e-5);
  EXPECT_EQ(networks.MixtureLogWeights().exp()[1].item<double>(), 0.0);
  // Its responsibilities are 0, and so is what it is taught.
  ActionDivergence(BaseLogResponsibilities(log_p.detach(), at::zeros_like(log_p)), log_p)
      .sum()
      .backward();
  const at::Tensor bias =
      networks["action_predictor." +
               std::to_string(settings.model().action_predictor().hidden_size()) + ".bias"];
  EXPECT_EQ(bias.grad()[1].item<double>(), 0.0);
}

}  // namespace
}  // namespace maneuver::learning::dirichlet_weights_test
