#include "model/evaluation/answer_difference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace maneuver::evaluation::answer_difference_test {
namespace {

using inference::Trajectory;

using ::testing::DoubleEq;
using ::testing::Optional;

constexpr double kTolerance = 1e-12;

// Returns a manifest with `waypoints` every `interval` seconds and effective actions that drive
// straight ahead at these speeds, m/s.
v1::ModelManifest Manifest(int waypoints, double interval, const std::vector<double>& speeds) {
  v1::ModelManifest manifest;
  v1::TrajectorySpec& trajectory = *manifest.mutable_spec()->mutable_trajectory();
  trajectory.set_waypoints(waypoints);
  trajectory.mutable_waypoint_interval()->set_seconds(static_cast<int64_t>(interval));
  trajectory.mutable_waypoint_interval()->set_nanos(
      static_cast<int32_t>(std::lround(std::fmod(interval, 1.0) * 1e9)));
  manifest.mutable_spec()->set_actions(static_cast<int>(speeds.size()));
  for (const double speed : speeds) {
    v1::Action& action = *manifest.add_actions();
    action.set_action_id(manifest.actions_size() - 1);
    action.set_usage(1.0 / static_cast<double>(speeds.size()));
    action.set_effective(true);
    for (int t = 1; t <= waypoints; ++t) {
      v1::Trajectory& mean = *action.mutable_distribution()->mutable_mean_trajectory();
      mean.add_x(speed * interval * t);
      mean.add_y(0.0);
    }
  }
  return manifest;
}

// Returns a straight trajectory at `speed`, `side` metres to the left.
Trajectory Straight(int waypoints, double interval, double speed, double side = 0.0) {
  Trajectory trajectory(waypoints, 2);
  for (int t = 0; t < waypoints; ++t) trajectory.row(t) << speed * interval * (t + 1), side;
  return trajectory;
}

VersionAnswer Answer(const std::vector<double>& probabilities,
                     const std::vector<Trajectory>& means) {
  VersionAnswer answer;
  answer.probabilities = Eigen::Map<const Eigen::VectorXd>(
      probabilities.data(), static_cast<Eigen::Index>(probabilities.size()));
  for (size_t i = 0; i < means.size(); ++i) {
    inference::ActionDistribution& action = answer.actions.emplace_back();
    action.action = static_cast<int>(i);
    action.sigma = {means[i]};
  }
  return answer;
}

AnswerComparison Comparison(const v1::ModelManifest& first, const v1::ModelManifest& second) {
  auto comparison = AnswerComparison::Make(first, second);
  EXPECT_TRUE(comparison.ok()) << comparison.status();
  return *std::move(comparison);
}

TEST(AnswerDifferenceTest, EqualAnswersHaveNoDifference) {
  const auto manifest = Manifest(5, 0.5, {3.0, 8.0, 13.0});
  const auto answer = Answer({0.2, 0.5, 0.3}, {Straight(5, 0.5, 3.1), Straight(5, 0.5, 7.9, 0.4),
                                               Straight(5, 0.5, 12.0, -3.3)});
  const AnswerDifference difference = Comparison(manifest, manifest).Compare(answer, answer);
  EXPECT_EQ(difference.expected, 0.0);
  EXPECT_EQ(difference.likeliest, 0.0);
  EXPECT_EQ(difference.energy, 0.0);
  EXPECT_THAT(difference.divergence, Optional(DoubleEq(0.0)));
  const double entropy = -0.2 * std::log(0.2) - 0.5 * std::log(0.5) - 0.3 * std::log(0.3);
  EXPECT_NEAR(difference.first_entropy, entropy, kTolerance);
  EXPECT_NEAR(difference.second_entropy, entropy, kTolerance);
}

// One version is certain of y = 0; the other says y = 2 or y = -2 with equal probability. Both have
// the same expectation.
TEST(AnswerDifferenceTest, DistancesMatchAHandComputedExample) {
  const auto first = Manifest(2, 1.0, {5.0});
  const auto second = Manifest(2, 1.0, {5.0, 30.0});
  const AnswerDifference difference =
      Comparison(first, second)
          .Compare(Answer({1.0}, {Straight(2, 1.0, 5.0)}),
                   Answer({0.5, 0.5}, {Straight(2, 1.0, 5.0, 2.0), Straight(2, 1.0, 5.0, -2.0)}));
  EXPECT_NEAR(difference.expected, 0.0, kTolerance);
  EXPECT_NEAR(difference.likeliest, 2.0, kTolerance);
  // 2 * 2 - 0 - (2 * 0.25 * 4)
  EXPECT_NEAR(difference.energy, 2.0, kTolerance);
  EXPECT_NEAR(difference.first_entropy, 0.0, kTolerance);
  EXPECT_NEAR(difference.second_entropy, std::log(2.0), kTolerance);
  // p = (1, 0), q = (1/2, 1/2): 1/2 ln(4/3) + 1/2 (1/2 ln(2/3) + 1/2 ln 2).
  ASSERT_TRUE(difference.divergence.has_value());
  EXPECT_NEAR(*difference.divergence,
              0.5 * std::log(4.0 / 3.0) + 0.25 * std::log(2.0 / 3.0) + 0.25 * std::log(2.0),
              kTolerance);
}

TEST(AnswerDifferenceTest, TheEnergyDistanceOfCertainAnswersIsTwiceTheirDistance) {
  const auto manifest = Manifest(4, 0.5, {1.0, 20.0});
  // At 0.5 .. 2 s, 3 m/s apart: 3 * 1.25 m on average.
  const AnswerDifference difference = Comparison(manifest, manifest)
                                          .Compare(Answer({1.0, 0.0}, {Straight(4, 0.5, 5.0)}),
                                                   Answer({1.0, 0.0}, {Straight(4, 0.5, 8.0)}));
  EXPECT_NEAR(difference.expected, 3.75, kTolerance);
  EXPECT_NEAR(difference.likeliest, 3.75, kTolerance);
  EXPECT_NEAR(difference.energy, 7.5, kTolerance);
  EXPECT_THAT(difference.divergence, Optional(DoubleEq(0.0)));
}

TEST(AnswerDifferenceTest, ActionsMatchByTrajectoryAndNotByNumber) {
  const auto first = Manifest(5, 1.0, {3.0, 8.0, 13.0});
  const auto second = Manifest(5, 1.0, {13.0, 3.0, 8.0});
  const std::vector<Trajectory> any(3, Straight(5, 1.0, 5.0));
  const AnswerComparison comparison = Comparison(first, second);
  EXPECT_EQ(comparison.agreeing_pairs(), 3);
  const VersionAnswer answer = Answer({0.7, 0.2, 0.1}, any);
  EXPECT_NEAR(*comparison.Compare(answer, Answer({0.1, 0.7, 0.2}, any)).divergence, 0.0,
              kTolerance);
  EXPECT_GT(*comparison.Compare(answer, answer).divergence, 0.1);
}

TEST(AnswerDifferenceTest, ActionsThatTheOtherVersionLacksDivergeEntirely) {
  const auto first = Manifest(5, 1.0, {3.0, 8.0});
  const auto second = Manifest(5, 1.0, {23.0, 28.0, 33.0});
  const AnswerComparison comparison = Comparison(first, second);
  EXPECT_EQ(comparison.agreeing_pairs(), 0);
  const VersionAnswer ours = Answer({0.5, 0.5}, std::vector<Trajectory>(2, Straight(5, 1.0, 5.0)));
  const VersionAnswer theirs =
      Answer({0.2, 0.2, 0.6}, std::vector<Trajectory>(3, Straight(5, 1.0, 5.0)));
  EXPECT_NEAR(*comparison.Compare(ours, theirs).divergence, std::log(2.0), kTolerance);
}

TEST(AnswerDifferenceTest, IneffectiveActionsCountAsOneOutcome) {
  auto first = Manifest(5, 1.0, {3.0, 8.0, 60.0});
  auto second = Manifest(5, 1.0, {3.0, 8.0, 80.0, 90.0});
  first.mutable_actions(2)->set_effective(false);
  second.mutable_actions(2)->set_effective(false);
  second.mutable_actions(3)->set_effective(false);
  const VersionAnswer ours =
      Answer({0.5, 0.46, 0.04}, std::vector<Trajectory>(3, Straight(5, 1.0, 5.0)));
  const VersionAnswer theirs =
      Answer({0.5, 0.46, 0.01, 0.03}, std::vector<Trajectory>(4, Straight(5, 1.0, 5.0)));
  EXPECT_NEAR(*Comparison(first, second).Compare(ours, theirs).divergence, 0.0, kTolerance);
}

// The second version looks further ahead, with other steps: it is interpolated linearly between its
// waypoints, and from the origin to the first.
TEST(AnswerDifferenceTest, ComparesVersionsWithOtherWaypointsOverTheirCommonHorizon) {
  const auto first = Manifest(6, 0.5, {4.0});   // 0.5 .. 3 s
  const auto second = Manifest(3, 0.8, {4.0});  // 0.8, 1.6, 2.4 s
  const AnswerComparison comparison = Comparison(first, second);
  const VersionAnswer ours = Answer({1.0}, {Straight(6, 0.5, 4.0)});
  const AnswerDifference same = comparison.Compare(ours, Answer({1.0}, {Straight(3, 0.8, 4.0)}));
  EXPECT_NEAR(same.expected, 0.0, kTolerance);
  EXPECT_NEAR(same.energy, 0.0, kTolerance);
  EXPECT_FALSE(same.divergence.has_value());
  // 0.5, 1, 1.5 and 2 s are common; the second is 2 m/s slower.
  const AnswerDifference slower = comparison.Compare(ours, Answer({1.0}, {Straight(3, 0.8, 2.0)}));
  EXPECT_NEAR(slower.likeliest, 2.0 * (0.5 + 1.0 + 1.5 + 2.0) / 4.0, kTolerance);
}

TEST(AnswerDifferenceTest, RefusesVersionsWithoutACommonWaypoint) {
  EXPECT_EQ(
      AnswerComparison::Make(Manifest(2, 2.0, {4.0}), Manifest(3, 0.5, {4.0})).status().code(),
      absl::StatusCode::kInvalidArgument);
}

TEST(AnswerDifferenceTest, TheMixtureConsistsOfTheGivenActions) {
  const auto manifest = Manifest(2, 1.0, {5.0, 30.0});
  const VersionAnswer whole = Answer({1.0, 0.0}, {Straight(2, 1.0, 5.0)});
  // Only 0.999 of the probability is given; it counts as the whole.
  const VersionAnswer part = Answer({0.999, 0.001}, {Straight(2, 1.0, 5.0)});
  EXPECT_NEAR(Comparison(manifest, manifest).Compare(whole, part).expected, 0.0, kTolerance);
}

TEST(AnswerDifferenceTest, TheSmallerOfTwoEquallyProbableIdsIsTheLikeliest) {
  const auto manifest = Manifest(2, 1.0, {5.0, 30.0});
  VersionAnswer turned = Answer({0.5, 0.5}, {Straight(2, 1.0, 5.0), Straight(2, 1.0, 30.0)});
  const VersionAnswer answer = turned;
  std::swap(turned.actions[0], turned.actions[1]);
  EXPECT_EQ(Comparison(manifest, manifest).Compare(answer, turned).likeliest, 0.0);
}

}  // namespace
}  // namespace maneuver::evaluation::answer_difference_test
