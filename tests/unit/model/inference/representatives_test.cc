#include "model/inference/representatives.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace maneuver::inference::representatives_test {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;

// Trajectories that stand still at these x, [T, 2] each.
TrajectorySet StandingAt(const std::vector<double>& xs, Eigen::Index waypoints = 1) {
  TrajectorySet::Rows rows(static_cast<Eigen::Index>(xs.size()), 2 * waypoints);
  rows.setZero();
  for (Eigen::Index n = 0; n < rows.rows(); ++n) {
    for (Eigen::Index t = 0; t < waypoints; ++t) rows(n, 2 * t) = xs[static_cast<size_t>(n)];
  }
  return TrajectorySet(std::move(rows));
}

Eigen::VectorXd Vector(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

std::vector<int> All(int actions) {
  std::vector<int> all;
  for (int k = 0; k < actions; ++k) all.push_back(k);
  return all;
}

std::vector<int> Actions(const std::vector<Representative>& representatives) {
  std::vector<int> actions;
  for (const Representative& each : representatives) actions.push_back(each.action);
  return actions;
}

std::vector<double> Weights(const std::vector<Representative>& representatives) {
  std::vector<double> weights;
  for (const Representative& each : representatives) weights.push_back(each.weight);
  return weights;
}

// A random mixture of smooth trajectories, 10 Hz.
struct Mixture {
  Eigen::VectorXd probabilities;
  TrajectorySet means;
};
Mixture RandomMixture(int actions, int waypoints, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Mixture mixture;
  mixture.probabilities.resize(actions);
  TrajectorySet::Rows rows(actions, 2 * waypoints);
  for (Eigen::Index k = 0; k < actions; ++k) {
    mixture.probabilities[k] = std::exp(normal(random));
    const double speed = 8.0 + 4.0 * normal(random);
    const double turn = 0.2 * normal(random);
    for (Eigen::Index t = 0; t < waypoints; ++t) {
      const double time = 0.1 * static_cast<double>(t + 1);
      rows(k, 2 * t) = speed * time * std::cos(turn * time);
      rows(k, 2 * t + 1) = speed * time * std::sin(turn * time);
    }
  }
  mixture.probabilities /= mixture.probabilities.sum();
  mixture.means = TrajectorySet(std::move(rows));
  return mixture;
}

// Mean distance at 0.5, 1, ... s of trajectories at 10 Hz.
double Distance(const TrajectorySet& means, int a, int b) {
  double sum = 0.0;
  int compared = 0;
  for (Eigen::Index t = 4; t < means[0].rows(); t += 5, ++compared) {
    sum += (means[static_cast<size_t>(a)].row(t) - means[static_cast<size_t>(b)].row(t)).norm();
  }
  return sum / compared;
}

// E min_j D_jk over k: what the representatives are to make small.
double ExpectedDistance(const Mixture& mixture, const std::vector<int>& chosen) {
  double sum = 0.0;
  for (int k = 0; k < mixture.probabilities.size(); ++k) {
    double nearest = HUGE_VAL;
    for (const int j : chosen) nearest = std::min(nearest, Distance(mixture.means, j, k));
    sum += mixture.probabilities[k] * nearest;
  }
  return sum;
}

TEST(RepresentativesTest, TheMedoidIsTheWeightedMedianAndNotTheMostProbableAction) {
  // On a line the action with the least expected distance is the median: 0.4 | 0.3 0.3.
  const auto chosen =
      ChooseRepresentatives(Vector({0.4, 0.3, 0.3}), All(3), StandingAt({0.0, 10.0, 12.0}), 0.5, 1);
  ASSERT_EQ(chosen.size(), 1u);
  EXPECT_EQ(chosen[0].action, 1);
  EXPECT_DOUBLE_EQ(chosen[0].weight, 1.0);
}

TEST(RepresentativesTest, EachFurtherRepresentativeIsTheBestByBruteForce) {
  for (uint32_t seed = 0; seed < 50; ++seed) {
    const Mixture mixture = RandomMixture(9, 30, seed);
    const auto chosen =
        Actions(ChooseRepresentatives(mixture.probabilities, All(9), mixture.means, 0.1, 5));
    ASSERT_EQ(chosen.size(), 5u);
    for (size_t n = 0; n < chosen.size(); ++n) {
      std::vector<int> so_far(chosen.begin(), chosen.begin() + static_cast<long>(n));
      std::vector<int> best = so_far;
      best.push_back(chosen[n]);
      const double least = ExpectedDistance(mixture, best);
      for (int other = 0; other < 9; ++other) {
        std::vector<int> instead = so_far;
        instead.push_back(other);
        EXPECT_LE(least, ExpectedDistance(mixture, instead) + 1e-12) << seed << " " << n;
      }
    }
    EXPECT_EQ(std::set<int>(chosen.begin(), chosen.end()).size(), 5u);
  }
}

TEST(RepresentativesTest, WeightsAreTheProbabilityOfTheNearestActions) {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Mixture mixture = RandomMixture(9, 30, seed);
    const auto chosen = ChooseRepresentatives(mixture.probabilities, All(9), mixture.means, 0.1, 3);
    std::vector<double> expected(3, 0.0);
    for (int k = 0; k < 9; ++k) {
      size_t nearest = 0;
      for (size_t n = 1; n < 3; ++n) {
        if (Distance(mixture.means, chosen[n].action, k) <
            Distance(mixture.means, chosen[nearest].action, k)) {
          nearest = n;
        }
      }
      expected[nearest] += mixture.probabilities[k];
    }
    double sum = 0.0;
    for (size_t n = 0; n < 3; ++n) {
      EXPECT_NEAR(chosen[n].weight, expected[n], 1e-12);
      sum += chosen[n].weight;
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
  }
}

TEST(RepresentativesTest, FewerRepresentativesAreAPrefixOfMore) {
  const Mixture mixture = RandomMixture(12, 50, 3);
  const auto six =
      Actions(ChooseRepresentatives(mixture.probabilities, All(12), mixture.means, 0.1, 6));
  const auto two =
      Actions(ChooseRepresentatives(mixture.probabilities, All(12), mixture.means, 0.1, 2));
  EXPECT_THAT(two, ElementsAre(six[0], six[1]));
}

TEST(RepresentativesTest, TiesGoToTheSmallerId) {
  // Both costs are 5; then actions 2 and 3 are alike, and action 2 stands for both.
  const auto chosen = ChooseRepresentatives(Vector({0.25, 0.25, 0.25, 0.25}), All(4),
                                            StandingAt({0.0, 0.0, 10.0, 10.0}), 0.5, 4);
  EXPECT_THAT(Actions(chosen), ElementsAre(0, 2, 1, 3));
  EXPECT_THAT(Weights(chosen), ElementsAre(0.5, 0.5, 0.0, 0.0));
}

TEST(RepresentativesTest, AsManyRepresentativesAsActionsAreAllActions) {
  const auto chosen =
      ChooseRepresentatives(Vector({0.5, 0.5}), All(2), StandingAt({0.0, 1.0}), 0.5, 7);
  EXPECT_THAT(Actions(chosen), ElementsAre(0, 1));
  EXPECT_TRUE(
      ChooseRepresentatives(Vector({0.5, 0.5}), All(2), StandingAt({0.0, 1.0}), 0.5, 0).empty());
}

// At 10 Hz, waypoints 4, 9, ... count. At 2 Hz and below, each one counts. The last always counts.
TEST(RepresentativesTest, ComparesWaypointsHalfASecondApart) {
  const auto medoid = [](Eigen::Index waypoints, Eigen::Index moved, double interval) {
    // Actions 0 and 2 are 1 m to either side of action 1, but at the waypoint `moved` action 1 is
    // far from both.
    TrajectorySet::Rows rows = TrajectorySet::Rows::Zero(3, 2 * waypoints);
    for (Eigen::Index t = 0; t < waypoints; ++t) {
      rows(0, 2 * t + 1) = -1.0;
      rows(2, 2 * t + 1) = 1.0;
    }
    rows(1, 2 * moved) = 1000.0;
    return ChooseRepresentatives(Vector({0.34, 0.32, 0.34}), All(3), TrajectorySet(rows), interval,
                                 1)[0]
        .action;
  };
  EXPECT_EQ(medoid(50, 3, 0.1), 1);
  EXPECT_EQ(medoid(50, 4, 0.1), 0);
  EXPECT_EQ(medoid(50, 49, 0.1), 0);
  EXPECT_EQ(medoid(48, 47, 0.1), 0);
  EXPECT_EQ(medoid(48, 46, 0.1), 1);
  EXPECT_EQ(medoid(10, 3, 0.5), 0);
  EXPECT_EQ(medoid(5, 3, 1.0), 0);
  EXPECT_EQ(medoid(3, 2, 0.1), 0);
}

TEST(RepresentativesTest, NegligibleActionsComeLastAndHaveNoInfluence) {
  const Eigen::VectorXd probabilities = Vector({0.4e-4, 0.6, 1e-4, 0.39975, 0.5e-4, 1e-5});
  const std::vector<int> candidates = RepresentativeCandidates(probabilities);
  EXPECT_THAT(candidates, ElementsAre(1, 2, 3));
  const auto choose = [&](int count) {
    return ChooseRepresentatives(probabilities, candidates, StandingAt({5.0, 0.0, 9.0}), 0.5,
                                 count);
  };
  EXPECT_THAT(Actions(choose(2)), ElementsAre(1, 3));
  EXPECT_THAT(Actions(choose(6)), ElementsAre(1, 3, 2, 4, 0, 5));
  const double sum = 0.6 + 1e-4 + 0.39975;
  EXPECT_THAT(Weights(choose(2)),
              ElementsAre(DoubleNear((0.6 + 1e-4) / sum, 1e-12), DoubleNear(0.39975 / sum, 1e-12)));
  EXPECT_THAT(Weights(choose(6)),
              ElementsAre(DoubleNear(0.6 / sum, 1e-12), DoubleNear(0.39975 / sum, 1e-12),
                          DoubleNear(1e-4 / sum, 1e-12), 0.0, 0.0, 0.0));
}

TEST(RepresentativesTest, NonFiniteNumbersStillGiveDistinctActions) {
  const double nan = std::nan("");
  const auto among = [&](const std::vector<int>& candidates, const TrajectorySet& means) {
    const auto chosen =
        Actions(ChooseRepresentatives(Vector({nan, nan, nan}), candidates, means, 0.5, 3));
    return std::set<int>(chosen.begin(), chosen.end()).size();
  };
  EXPECT_EQ(among(RepresentativeCandidates(Vector({nan, nan, nan})), {}), 3u);
  EXPECT_EQ(among(All(3), StandingAt({nan, 1.0, nan})), 3u);
}

}  // namespace
}  // namespace maneuver::inference::representatives_test
