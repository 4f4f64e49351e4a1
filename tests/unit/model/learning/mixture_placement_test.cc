#include "model/learning/mixture_placement.h"

#include <ATen/ops/equal.h>
#include <gtest/gtest.h>

#include <cmath>

#include "model/learning/networks.h"

namespace maneuver::learning::mixture_placement_test {
namespace {

constexpr int kActions = 4;
constexpr int64_t kExamples = 400;

// Straight trajectories of four well-separated lengths, encoded as four tight groups.
EncodedExamples FourGroups() {
  at::Generator generator = MakeGenerator(5);
  const at::Tensor group = at::arange(kExamples, at::kLong).remainder(4);
  const at::Tensor corners = at::tensor({-3.F, -3.F, -3.F, 3.F, 3.F, -3.F, 3.F, 3.F}).view({4, 2});
  const at::Tensor mean =
      corners.index_select(0, group) + at::empty({kExamples, 2}).normal_(0.0, 0.2, generator);
  const at::Tensor reach = group.to(at::kFloat) * 20.0;
  at::Tensor trajectories = at::zeros({kExamples, 6});
  for (int t = 0; t < 3; ++t) trajectories.select(1, 2 * t).copy_(reach * (t + 1) / 3.0);
  return {
      trajectories, {.waypoint_interval = 1.0}, {mean, at::full({kExamples, 2}, std::log(0.01))}};
}

double NearestDistance(const at::Tensor& means, const at::Tensor& point) {
  return (means - point).square().sum(1).sqrt().min().item<double>();
}

class PlacementTest : public testing::TestWithParam<v1::MixturePlacement> {};

TEST_P(PlacementTest, HasTheRequestedSizeAndDependsOnlyOnTheSeed) {
  const EncodedExamples examples = FourGroups();
  const PlacedMixture placed = PlaceMixture(GetParam(), examples, kActions, 1);
  EXPECT_EQ(placed.components.mean.sizes().vec(), (std::vector<int64_t>{kActions, 2}));
  EXPECT_EQ(placed.components.log_variance.sizes().vec(), (std::vector<int64_t>{kActions, 2}));
  EXPECT_NEAR(placed.log_weights.exp().sum().item<double>(), 1.0, 1e-5);
  EXPECT_TRUE(placed.components.log_variance.isfinite().all().item<bool>());
  const PlacedMixture again = PlaceMixture(GetParam(), examples, kActions, 1);
  EXPECT_TRUE(at::equal(placed.components.mean, again.components.mean));
}

INSTANTIATE_TEST_SUITE_P(
    Each, PlacementTest,
    testing::Values(v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS,
                    v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS, v1::MIXTURE_PLACEMENT_RANDOM,
                    v1::MIXTURE_PLACEMENT_UNIFORM, v1::MIXTURE_PLACEMENT_ENCODED_POINTS,
                    v1::MIXTURE_PLACEMENT_ENCODED_SEEDS, v1::MIXTURE_PLACEMENT_FITTED_MIXTURE));

// Group means are within 0.1 of the corners; their variance is 0.2^2 + 0.01.
void ExpectTheFourGroups(const PlacedMixture& placed) {
  for (const auto& [x, y] : {std::pair(-3.F, -3.F), {-3.F, 3.F}, {3.F, -3.F}, {3.F, 3.F}}) {
    EXPECT_LT(NearestDistance(placed.components.mean, at::tensor({x, y})), 0.1);
  }
  EXPECT_LT((placed.components.log_variance.exp() - 0.05).abs().max().item<double>(), 0.02);
  EXPECT_LT((placed.log_weights.exp() - 0.25).abs().max().item<double>(), 0.01);
}

TEST(MixturePlacementTest, TrajectoryClustersTakeTheMomentsOfTheirEncodings) {
  ExpectTheFourGroups(
      PlaceMixture(v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, FourGroups(), kActions, 1));
}

TEST(MixturePlacementTest, VelocityClustersTakeTheMomentsOfTheirEncodings) {
  ExpectTheFourGroups(
      PlaceMixture(v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS, FourGroups(), kActions, 1));
}

// Over one window of half a second each, at 2 waypoints a second.
TEST(MixturePlacementTest, VelocitiesAreCompressedLogarithmicallyAndKeepTheirDirection) {
  // From the origin 3 m ahead, then 4 m to the left, then no further.
  const at::Tensor trajectory = at::tensor({3.F, 0.F, 3.F, 4.F, 3.F, 4.F}).view({1, 6});
  const at::Tensor space = ClusterSpace(v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS, trajectory,
                                        {.waypoint_interval = 0.5, .slow_speed = 1.0 / 3.0});
  const std::vector<double> expected = {std::log(19.0), 0.0, 0.0, std::log(25.0), 0.0, 0.0};
  ASSERT_EQ(space.size(1), 6);
  for (int64_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(space[0][i].item<double>(), expected[static_cast<size_t>(i)], 1e-5) << i;
  }
}

TEST(MixturePlacementTest, VelocitiesAreAveragedOverHalfASecond) {
  // Ten waypoints a second: two whole windows, of 1 m and of 2 m, and what is left over.
  at::Tensor trajectory = at::zeros({1, 24});
  for (int t = 0; t < 12; ++t) {
    trajectory[0][2 * t].fill_(t < 5 ? 0.2 * (t + 1) : 1.0 + 0.4 * (t - 4));
  }
  const at::Tensor space =
      ClusterSpace(v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS, trajectory, {.waypoint_interval = 0.1});
  ASSERT_EQ(space.size(1), 4);
  EXPECT_NEAR(space[0][0].item<double>(), std::log(3.0), 1e-5);
  EXPECT_NEAR(space[0][2].item<double>(), std::log(5.0), 1e-5);
}

TEST(MixturePlacementTest, EachTrajectoryIsNearestToTheCentreOfItsGroup) {
  const EncodedExamples examples = FourGroups();
  for (const auto placement :
       {v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS}) {
    const PlacedMixture placed = PlaceMixture(placement, examples, kActions, 1);
    const at::Tensor cluster =
        NearestClusters(placement, placed.centers, examples.trajectories, examples.scale);
    for (int64_t i = 0; i < kExamples; ++i) {
      const int64_t own = cluster[i].item<int64_t>();
      EXPECT_EQ(own, cluster[i % 4].item<int64_t>());
      EXPECT_LT((placed.components.mean[own] - examples.q_z.mean[i]).abs().max().item<double>(),
                1.0);
    }
  }
}

TEST(MixturePlacementTest, AFittedMixtureFindsTheGroups) {
  ExpectTheFourGroups(
      PlaceMixture(v1::MIXTURE_PLACEMENT_FITTED_MIXTURE, FourGroups(), kActions, 1));
}

TEST(MixturePlacementTest, SeedsAreEncodingsThatLieFarApart) {
  const EncodedExamples examples = FourGroups();
  for (const auto placement :
       {v1::MIXTURE_PLACEMENT_ENCODED_POINTS, v1::MIXTURE_PLACEMENT_ENCODED_SEEDS}) {
    const at::Tensor means = PlaceMixture(placement, examples, kActions, 1).components.mean;
    for (int k = 0; k < kActions; ++k) {
      EXPECT_EQ(NearestDistance(examples.q_z.mean, means[k]), 0.0);
    }
  }
  const at::Tensor seeds =
      PlaceMixture(v1::MIXTURE_PLACEMENT_ENCODED_SEEDS, examples, kActions, 1).components.mean;
  for (int k = 0; k < kActions; ++k) {
    EXPECT_LT(NearestDistance(seeds, at::tensor({k < 2 ? -3.F : 3.F, k % 2 == 0 ? -3.F : 3.F})),
              1.0);
  }
}

TEST(MixturePlacementTest, UniformMeansLieInTheBoxOfTheEncodings) {
  const EncodedExamples examples = FourGroups();
  const at::Tensor means =
      PlaceMixture(v1::MIXTURE_PLACEMENT_UNIFORM, examples, 64, 1).components.mean;
  EXPECT_TRUE((means.amin(0) >= examples.q_z.mean.amin(0)).all().item<bool>());
  EXPECT_TRUE((means.amax(0) <= examples.q_z.mean.amax(0)).all().item<bool>());
  EXPECT_GT(means.var(0).min().item<double>(), 1.0);
}

TEST(MixturePlacementTest, LabelledComponentsLieAtTheirExamples) {
  const EncodedExamples examples = FourGroups();
  // The last group is label 0, and the second one label 1; ten examples of each are known.
  std::vector<int> labels(kExamples, -1);
  for (int i = 0; i < 40; i += 4) {
    labels[static_cast<size_t>(i) + 3] = 0;
    labels[static_cast<size_t>(i) + 1] = 1;
  }
  const PlacedMixture placed =
      PlaceLabelledMixture(v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, examples, labels, 2, 6, 1);
  EXPECT_EQ(placed.components.mean.size(0), 6);
  EXPECT_LT(NearestDistance(placed.components.mean.slice(0, 0, 1), at::tensor({3.F, 3.F})), 0.3);
  EXPECT_LT(NearestDistance(placed.components.mean.slice(0, 1, 2), at::tensor({-3.F, 3.F})), 0.3);
}

}  // namespace
}  // namespace maneuver::learning::mixture_placement_test
