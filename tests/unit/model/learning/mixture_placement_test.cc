#include "model/learning/mixture_placement.h"

#include <ATen/ops/equal.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "model/data/example_index.h"
#include "model/learning/learner.h"
#include "model/learning/networks.h"
#include "model/learning/objectives.h"
#include "model/learning/phases/learning_state.h"
#include "model/learning/phases/mixture.h"
#include "model/learning/phases/place.h"
#include "model/learning/phases/pretrain.h"
#include "model/learning/scene_bound.h"
#include "model/learning/training_data.h"
#include "model/learning/training_progress.h"
#include "model/learning/validation.h"
#include "tests/unit/model/learning/analytic_scenes.h"

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
                    v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS,
                    v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, v1::MIXTURE_PLACEMENT_RANDOM,
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

TEST(MixturePlacementTest, DepartureClustersTakeTheMomentsOfTheirEncodings) {
  ExpectTheFourGroups(
      PlaceMixture(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, FourGroups(), kActions, 1));
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

// Departures with plain loops. `every` waypoints are half a second, or come nearest to it.
std::vector<double> PlainDepartures(const std::vector<float>& trajectory, double interval,
                                    size_t every) {
  const size_t waypoints = trajectory.size() / 2;
  std::vector<double> departures;
  for (size_t number = std::min(every, waypoints); number <= waypoints; number += every) {
    const double time = interval * static_cast<double>(number);
    for (const size_t coordinate : {2 * number - 2, 2 * number - 1}) {
      departures.push_back(trajectory[coordinate] / std::sqrt(time + 0.5));
    }
  }
  return departures;
}

TEST(MixturePlacementTest, DeparturesAreDividedByTheRootOfTheirTimeAndHalfASecond) {
  struct Case {
    double interval;
    size_t every;
    int64_t waypoints;
  };
  // The last one ends before half a second, so its last waypoint counts.
  for (const Case& each : {Case{0.1, 5, 50},
                           {0.1, 5, 33},
                           {0.25, 2, 12},
                           {0.3, 2, 10},
                           {0.5, 1, 6},
                           {1.0, 1, 3},
                           {0.1, 5, 3}}) {
    at::Generator generator = MakeGenerator(4);
    const at::Tensor rows = at::empty({7, 2 * each.waypoints}).normal_(0.0, 9.0, generator);
    // The speed that counts as slow is for velocities.
    for (const double slow_speed : {0.1, 10.0}) {
      const at::Tensor space =
          ClusterSpace(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, rows,
                       {.waypoint_interval = each.interval, .slow_speed = slow_speed});
      for (int64_t row = 0; row < rows.size(0); ++row) {
        const float* numbers = rows[row].data_ptr<float>();
        const std::vector<double> expected =
            PlainDepartures({numbers, numbers + rows.size(1)}, each.interval, each.every);
        ASSERT_EQ(space.size(1), static_cast<int64_t>(expected.size())) << each.interval;
        for (size_t i = 0; i < expected.size(); ++i) {
          EXPECT_NEAR(space[row][static_cast<int64_t>(i)].item<double>(), expected[i],
                      1e-5 * (1.0 + std::abs(expected[i])))
              << each.interval << " " << i;
        }
      }
    }
  }
}

// What the examples of a vehicle do after a straight second.
enum Continuation { kStraight, kLeft, kRight };
struct Continuations {
  EncodedExamples examples;
  std::vector<Continuation> of;  // [N]
  std::vector<double> speeds;    // [N] m/s
};

// Vehicles that drive straight on at 0.8 to 20 m/s, and others that are about to turn.
Continuations StraightAndTurning(const v1::TrainingSettings& settings) {
  Continuations all;
  std::vector<data::Example> examples;
  const auto add = [&](const v1::Scenario& recording, Continuation continuation, double speed) {
    for (data::Example& example :
         data::EnumerateExamples(recording, 0, settings.model(), settings.examples())) {
      if (continuation != kStraight && (example.time < 1.2 || example.time > 2.01)) continue;
      examples.push_back(std::move(example));
      all.of.push_back(continuation);
      all.speeds.push_back(speed);
    }
  };
  for (const double speed : {0.8, 3.0, 8.0, 14.0, 20.0}) {
    add(ArcRecording("straight", 0.0, speed), kStraight, speed);
  }
  for (int i = 0; i < 6; ++i) {
    const double curvature = 0.04 + 0.001 * i;
    add(ForkRecording("left", Fork::kBoth, true, curvature), kLeft, 8.0);
    add(ForkRecording("right", Fork::kBoth, false, curvature), kRight, 8.0);
  }
  const auto count = static_cast<int64_t>(examples.size());
  all.examples.trajectories = Trajectories(examples);
  all.examples.scale = ScaleOf(settings);
  all.examples.q_z = {at::zeros({count, 2}), at::full({count, 2}, std::log(0.01))};
  for (int64_t i = 0; i < count; ++i) {
    all.examples.q_z.mean[i][0].fill_(static_cast<double>(all.of[static_cast<size_t>(i)]));
  }
  return all;
}

// The clusters that the examples of a continuation are in.
std::set<int64_t> ClustersOf(Continuation continuation, const Continuations& all,
                             const PlacedMixture& placed) {
  const at::Tensor clusters =
      NearestClusters(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, placed.centers,
                      all.examples.trajectories, all.examples.scale);
  std::set<int64_t> found;
  for (size_t i = 0; i < all.of.size(); ++i) {
    if (all.of[i] == continuation) found.insert(clusters[static_cast<int64_t>(i)].item<int64_t>());
  }
  return found;
}

TEST(MixturePlacementTest, DepartureClustersTellTurnsFromStraightDrivingAtEverySpeed) {
  const Continuations all = StraightAndTurning(TinyLanesSettings());
  ASSERT_EQ(std::set(all.speeds.begin(), all.speeds.end()).size(), 5u);
  const PlacedMixture placed =
      PlaceMixture(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, all.examples, 3, 1);
  std::set<int64_t> clusters;
  for (const Continuation continuation : {kStraight, kLeft, kRight}) {
    const std::set<int64_t> own = ClustersOf(continuation, all, placed);
    ASSERT_EQ(own.size(), 1u) << continuation;
    clusters.insert(*own.begin());
    EXPECT_NEAR(placed.components.mean[*own.begin()][0].item<double>(), continuation, 1e-5);
  }
  EXPECT_EQ(clusters.size(), 3u);
  // In metres, without a reference, vehicles that drive straight on are apart by their speed.
  const Continuations metres = StraightAndTurning(TinyLanesSettings("lanes-metres"));
  EXPECT_GT(
      ClustersOf(kStraight, metres,
                 PlaceMixture(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, metres.examples, 3, 1))
          .size(),
      1u);
}

// Components without a cluster stay at the prior, and the others have a cluster each.
TEST(MixturePlacementTest, FewerTrajectoriesThanActionsLeaveTheOtherComponentsAtThePrior) {
  const EncodedExamples groups = FourGroups();
  for (const auto placement :
       {v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS,
        v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS}) {
    // 400 examples of four trajectories, and four examples.
    for (const int64_t count : {kExamples, int64_t{4}}) {
      constexpr int kMore = 9;
      const EncodedExamples few{
          groups.trajectories.slice(0, 0, count),
          groups.scale,
          {groups.q_z.mean.slice(0, 0, count), groups.q_z.log_variance.slice(0, 0, count)}};
      const PlacedMixture placed = PlaceMixture(placement, few, kMore, 1);
      ASSERT_EQ(placed.components.mean.size(0), kMore);
      EXPECT_TRUE(placed.components.mean.isfinite().all().item<bool>());
      EXPECT_TRUE(placed.components.log_variance.isfinite().all().item<bool>());
      EXPECT_NEAR(placed.log_weights.exp().sum().item<double>(), 1.0, 1e-5);
      const at::Tensor own =
          NearestClusters(placement, placed.centers, few.trajectories, few.scale);
      std::set<int64_t> used;
      for (int64_t i = 0; i < count; ++i) {
        used.insert(own[i].item<int64_t>());
        EXPECT_LT((placed.components.mean[own[i].item<int64_t>()] - few.q_z.mean[i])
                      .abs()
                      .max()
                      .item<double>(),
                  1.0);
      }
      EXPECT_EQ(used.size(), 4u);
      for (int64_t k = 0; k < kMore; ++k) {
        if (used.contains(k)) continue;
        EXPECT_EQ(placed.components.mean[k].abs().max().item<double>(), 0.0);
        EXPECT_EQ(placed.components.log_variance[k].abs().max().item<double>(), 0.0);
      }
    }
  }
}

// Eight examples go one way and the others stay, so of three clusters one is empty.
TEST(MixturePlacementTest, SmallClustersTakeTheirShareOfTheVarianceAndEmptyOnesWeighLeast) {
  at::Generator generator = MakeGenerator(3);
  EncodedExamples examples{
      at::zeros({200, 6}),
      {.waypoint_interval = 1.0},
      {at::empty({200, 2}).normal_(0.0, 1.0, generator), at::full({200, 2}, std::log(0.01))}};
  examples.trajectories.slice(0, 0, 8).fill_(10.0);
  const PlacedMixture placed =
      PlaceMixture(v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, examples, 3, 1);
  const at::Tensor own = NearestClusters(v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, placed.centers,
                                         examples.trajectories, examples.scale);
  const auto few = own[0].item<int64_t>(), many = own[8].item<int64_t>();
  const at::Tensor weights = placed.log_weights.exp();
  // K^(2/D) is 3.
  const at::Tensor share = (examples.q_z.mean.var(0, /*unbiased=*/false) + 0.01) / 3.0;
  EXPECT_LT((placed.components.log_variance[few].exp() - share).abs().max().item<double>(), 1e-4);
  EXPECT_NEAR(weights[few].item<double>(), 8.0 / 201.0, 1e-6);
  EXPECT_NEAR(weights[many].item<double>(), 192.0 / 201.0, 1e-6);
  EXPECT_NEAR(weights[3 - few - many].item<double>(), 1.0 / 201.0, 1e-6);
}

TEST(MixturePlacementTest, EachTrajectoryIsNearestToTheCentreOfItsGroup) {
  const EncodedExamples examples = FourGroups();
  for (const auto placement :
       {v1::MIXTURE_PLACEMENT_TRAJECTORY_CLUSTERS, v1::MIXTURE_PLACEMENT_VELOCITY_CLUSTERS,
        v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS}) {
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

TEST(MixturePlacementTest, EachPlacementOfEachRunHasASeedOfItsOwn) {
  std::set<uint64_t> seeds;
  for (const uint64_t seed : {1u, 2u, 3u}) {
    EXPECT_EQ(PlacementSeed(seed, 0), seed);
    for (int i = 0; i < 3; ++i) seeds.insert(PlacementSeed(seed, i));
  }
  EXPECT_EQ(seeds.size(), 9u);
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

// Sharp turns to the left are labelled, and turns so sharp to the right are their mirror images.
TEST(LabelledMixtureTest, LabelledExamplesKeepTheirActionBesideTheClustersOfTheOthers) {
  v1::TrainingSettings settings = TinySettings();
  settings.mutable_examples()->set_validation_share(0.0);
  settings.mutable_augmentation()->set_mirror(true);
  v1::OptimizationSettings& optimization = *settings.mutable_optimization();
  optimization.set_mixture_placement(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS);
  optimization.set_clustered_share(1.0);
  std::vector<v1::Scenario> recordings = ArcRecordings(72);
  for (const char* id : {"sharp-0", "sharp-1", "sharp-2"}) {
    recordings.push_back(ArcRecording(id, 0.1, 8.0));
  }
  TrainingData data = *SplitRecordings(std::move(recordings), settings);
  data.label_names = {"sharp left"};
  for (const data::Example& example : data.training.examples) {
    const v1::Scenario& recording =
        data.training.recordings[static_cast<size_t>(example.recording)];
    data.labels.push_back(recording.scenario_id().starts_with("sharp") ? 0 : -1);
  }
  ASSERT_GT(std::ranges::count(data.labels, 0), 5);
  LearningState state(settings, data, at::Device(at::kCPU), 1, [] { return false; });
  const auto count = static_cast<int64_t>(data.training.examples.size());
  TrainingProgress progress(Learner::Plan(settings, {count, count, 0}), {},
                            [] { return std::chrono::system_clock::time_point(); });
  RankGroup alone([] { return false; });
  EpochLoop loop(settings, data, alone, progress);
  ASSERT_TRUE(Pretrain(state, loop).ok());
  ASSERT_TRUE(ChoosePlacement(state, loop).ok());
  ASSERT_TRUE(state.centers.defined());
  EXPECT_EQ(state.centers.size(0), settings.model().actions() - 1);
  ASSERT_TRUE(TrainMixture(state, loop).ok());

  at::NoGradGuard no_grad;
  at::Tensor mirrored = state.trajectories.clone();
  mirrored.view({count, -1, 2}).select(2, 1).neg_();
  const auto actions = [&state](const at::Tensor& x) {  // argmax q(y|x)
    const BaseModel model = ApplyBase(state.networks, {x, {}, {}},
                                      [](at::IntArrayRef shape) { return at::zeros(shape); });
    return BaseBound(model).log_responsibilities.argmax(1);
  };
  const at::Tensor own = actions(state.trajectories);
  const at::Tensor of_mirrored = actions(mirrored);
  for (int64_t i = 0; i < count; ++i) {
    const bool labelled = data.labels[static_cast<size_t>(i)] == 0;
    EXPECT_EQ(own[i].item<int64_t>() == 0, labelled) << i;
    EXPECT_NE(of_mirrored[i].item<int64_t>(), 0) << i;
  }
}

TEST(MixturePlacementTest, LabelsOfAllExamplesStillPlaceEveryAction) {
  const EncodedExamples examples = FourGroups();
  std::vector<int> labels(kExamples);
  for (size_t i = 0; i < labels.size(); ++i) labels[i] = i % 4 == 3 ? 0 : 1;
  for (const int unlabelled : {0, 1, 5}) {
    for (int i = 0; i < unlabelled; ++i) labels[static_cast<size_t>(i)] = -1;
    const PlacedMixture placed =
        PlaceLabelledMixture(v1::MIXTURE_PLACEMENT_DEPARTURE_CLUSTERS, examples, labels, 2, 6, 1);
    ASSERT_EQ(placed.components.mean.size(0), 6) << unlabelled;
    ASSERT_EQ(placed.components.log_variance.size(0), 6);
    EXPECT_EQ(placed.log_weights.size(0), 6);
    EXPECT_LT(NearestDistance(placed.components.mean.slice(0, 0, 1), at::tensor({3.F, 3.F})), 0.3);
    // The actions without a label are where the examples are.
    for (const auto& [x, y] : {std::pair(-3.F, -3.F), {-3.F, 3.F}, {3.F, -3.F}, {3.F, 3.F}}) {
      EXPECT_LT(NearestDistance(placed.components.mean.slice(0, 2), at::tensor({x, y})), 0.3);
    }
  }
}

}  // namespace
}  // namespace maneuver::learning::mixture_placement_test
