#include "model/inference/joint_combinations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <random>

namespace maneuver::inference::joint_combinations_test {
namespace {

using testing::DoubleEq;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kInterval = 0.5;
constexpr Eigen::Index kWaypoints = 10;

// A trajectory at constant velocity along the target's heading, [T, 2].
Trajectory Straight(double speed, Eigen::Index waypoints = kWaypoints,
                    double interval = kInterval) {
  Trajectory trajectory(waypoints, 2);
  for (Eigen::Index t = 0; t < waypoints; ++t) {
    trajectory(t, 0) = speed * interval * static_cast<double>(t + 1);
    trajectory(t, 1) = 0.0;
  }
  return trajectory;
}

struct Action {
  double probability;
  Trajectory mean;
};

// A car of 4.6 m x 2 m with the actions 10, 11, ...
JointTarget Car(int64_t id, const scene::Pose2& X_WT, const std::vector<Action>& actions) {
  JointTarget target{.id = id, .length = 4.6, .width = 2.0, .X_WT = X_WT};
  TrajectorySet::Rows rows(static_cast<Eigen::Index>(actions.size()),
                           actions.empty() ? 0 : actions[0].mean.size());
  for (size_t a = 0; a < actions.size(); ++a) {
    target.actions.push_back(10 + static_cast<int>(a));
    target.log_probabilities.push_back(std::log(actions[a].probability));
    rows.row(static_cast<Eigen::Index>(a)) =
        Eigen::Map<const Eigen::RowVectorXd>(actions[a].mean.data(), rows.cols());
  }
  target.means = TrajectorySet(std::move(rows));
  return target;
}

std::vector<std::vector<int>> Actions(const JointCombinations& answer) {
  std::vector<std::vector<int>> actions;
  for (const JointCombination& each : answer.combinations) actions.push_back(each.actions);
  return actions;
}

// Whether two cars that drive like this exclude each other.
bool Exclude(const JointTarget& a, const JointTarget& b, double interval = kInterval) {
  return CombineActions(std::vector{a, b}, interval, 1).combinations.empty();
}

// Cars around the origin that drive towards it, and turn more or less.
std::vector<JointTarget> RandomTargets(size_t count, int actions, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit;
  std::vector<JointTarget> targets;
  for (size_t i = 0; i < count; ++i) {
    const double angle = 2.0 * M_PI * (static_cast<double>(i) + unit(random)) / double(count);
    const double away = 15.0 + 15.0 * unit(random);
    std::vector<Action> choices;
    double sum = 0.0;
    for (int a = 0; a < actions; ++a) {
      const double speed = 10.0 * unit(random);
      const double turn = 0.3 * (unit(random) - 0.5);
      Trajectory mean(kWaypoints, 2);
      for (Eigen::Index t = 0; t < kWaypoints; ++t) {
        const double time = kInterval * static_cast<double>(t + 1);
        mean(t, 0) = speed * time * std::cos(turn * time);
        mean(t, 1) = speed * time * std::sin(turn * time);
      }
      choices.push_back({std::exp(3.0 * unit(random)), mean});
      sum += choices.back().probability;
    }
    for (Action& choice : choices) choice.probability /= sum;
    std::ranges::sort(choices, std::greater(), &Action::probability);
    targets.push_back(Car(100 - static_cast<int64_t>(i),
                          {away * std::cos(angle), away * std::sin(angle), angle + M_PI}, choices));
  }
  return targets;
}

// All combinations without a pair that excludes itself, by descending probability.
std::vector<double> BruteForce(const std::vector<JointTarget>& targets) {
  std::map<std::vector<size_t>, bool> excluded;  // i, a, j, b
  for (size_t i = 0; i < targets.size(); ++i) {
    for (size_t j = i + 1; j < targets.size(); ++j) {
      for (size_t a = 0; a < targets[i].actions.size(); ++a) {
        for (size_t b = 0; b < targets[j].actions.size(); ++b) {
          const auto only = [](const JointTarget& target, size_t action) {
            JointTarget one = target;
            one.actions = {target.actions[action]};
            one.log_probabilities = {target.log_probabilities[action]};
            one.means = TrajectorySet{target.means[action]};
            return one;
          };
          excluded[{i, a, j, b}] = Exclude(only(targets[i], a), only(targets[j], b));
        }
      }
    }
  }
  std::vector<double> scores;
  std::vector<size_t> chosen;
  const std::function<void(double)> choose = [&](double score) {
    const size_t j = chosen.size();
    if (j == targets.size()) return scores.push_back(score);
    for (size_t b = 0; b < targets[j].actions.size(); ++b) {
      bool free = true;
      for (size_t i = 0; i < j; ++i) free &= !excluded.at({i, chosen[i], j, b});
      if (!free) continue;
      chosen.push_back(b);
      choose(score + targets[j].log_probabilities[b]);
      chosen.pop_back();
    }
  };
  choose(0.0);
  std::ranges::sort(scores, std::greater());
  return scores;
}

TEST(JointCombinationsTest, AreTheMostProbableOnesOfAllThatAreFreeOfCollisions) {
  size_t some_excluded = 0;
  for (uint32_t seed = 0; seed < 60; ++seed) {
    const size_t count = 2 + seed % 3;
    const std::vector<JointTarget> targets = RandomTargets(count, 5, seed);
    const std::vector<double> all = BruteForce(targets);
    some_excluded += double(all.size()) < std::pow(5.0, double(count)) ? 1 : 0;
    const JointCombinations answer = CombineActions(targets, kInterval, 20);
    EXPECT_FALSE(answer.truncated);
    ASSERT_THAT(answer.combinations, SizeIs(std::min<size_t>(20, all.size()))) << seed;
    for (size_t n = 0; n < answer.combinations.size(); ++n) {
      const JointCombination& each = answer.combinations[n];
      EXPECT_NEAR(each.log_probability, all[n], 1e-12) << seed << " " << n;
      double sum = 0.0;
      for (size_t i = 0; i < count; ++i) {
        sum += targets[i].log_probabilities[static_cast<size_t>(each.actions[i] - 10)];
      }
      EXPECT_NEAR(each.log_probability, sum, 1e-12);
    }
  }
  EXPECT_GT(some_excluded, 30u);
}

TEST(JointCombinationsTest, TheOrderOfTheTargetsChangesNoBit) {
  for (uint32_t seed = 0; seed < 30; ++seed) {
    const std::vector<JointTarget> targets = RandomTargets(5, 6, seed);
    const JointCombinations answer = CombineActions(targets, kInterval, 12);
    std::vector<size_t> order = {3, 0, 4, 2, 1};
    std::vector<JointTarget> moved;
    moved.reserve(order.size());
    for (const size_t i : order) moved.push_back(targets[i]);
    const JointCombinations again = CombineActions(moved, kInterval, 12);
    ASSERT_EQ(again.combinations.size(), answer.combinations.size());
    for (size_t n = 0; n < answer.combinations.size(); ++n) {
      EXPECT_EQ(again.combinations[n].log_probability, answer.combinations[n].log_probability);
      EXPECT_EQ(again.combinations[n].weight, answer.combinations[n].weight);
      for (size_t i = 0; i < order.size(); ++i) {
        EXPECT_EQ(again.combinations[n].actions[i], answer.combinations[n].actions[order[i]]);
      }
    }
  }
}

TEST(JointCombinationsTest, OfOneTargetAreItsActions) {
  const JointTarget car = Car(1, {}, {{0.6, Straight(1.0)}, {0.2, Straight(2.0)}});
  const JointCombinations answer = CombineActions(std::vector{car}, kInterval, 6);
  EXPECT_THAT(Actions(answer), ElementsAre(ElementsAre(10), ElementsAre(11)));
  EXPECT_THAT(answer.combinations[0].weight, DoubleEq(0.75));
  EXPECT_THAT(answer.combinations[1].weight, DoubleEq(0.25));
  EXPECT_FALSE(answer.truncated);
}

TEST(JointCombinationsTest, WithoutTargetsOrActionsThereAreNone) {
  EXPECT_THAT(CombineActions({}, kInterval, 6).combinations, IsEmpty());
  const JointCombinations answer =
      CombineActions(std::vector{Car(1, {}, {}), Car(2, {}, {{1.0, Straight(1.0)}})}, kInterval, 6);
  EXPECT_THAT(answer.combinations, IsEmpty());
  EXPECT_FALSE(answer.truncated);
}

// Two cars meet at a crossing: one of them has to wait.
TEST(JointCombinationsTest, OneOfTwoCarsThatCrossWaits) {
  const JointTarget first = Car(1, {-15.0, 0.0, 0.0}, {{0.7, Straight(6.0)}, {0.3, Straight(0.2)}});
  const JointTarget second =
      Car(2, {0.0, -15.0, M_PI / 2}, {{0.6, Straight(6.0)}, {0.4, Straight(0.2)}});
  const JointCombinations answer = CombineActions(std::vector{first, second}, kInterval, 6);
  EXPECT_THAT(Actions(answer),
              ElementsAre(ElementsAre(10, 11), ElementsAre(11, 10), ElementsAre(11, 11)));
  EXPECT_NEAR(answer.combinations[0].weight, 0.28 / 0.58, 1e-12);
  EXPECT_NEAR(answer.combinations[2].weight, 0.12 / 0.58, 1e-12);
}

TEST(JointCombinationsTest, AreNoneIfEveryCombinationHasACollision) {
  const JointCombinations answer =
      CombineActions(std::vector{Car(1, {-20.0, 0.0, 0.0}, {{1.0, Straight(6.0)}}),
                                 Car(2, {20.0, 0.0, M_PI}, {{1.0, Straight(6.0)}})},
                     kInterval, 6);
  EXPECT_THAT(answer.combinations, IsEmpty());
  EXPECT_FALSE(answer.truncated);
}

// At 30 m/s they meet for less than 0.3 s, between two waypoints.
TEST(JointCombinationsTest, FastCarsThatCrossBetweenTwoWaypointsExcludeEachOther) {
  const auto crossing = [](double late) {
    return Exclude(Car(1, {-37.5, 0.0, 0.0}, {{1.0, Straight(30.0)}}),
                   Car(2, {0.0, -37.5 - late, M_PI / 2}, {{1.0, Straight(30.0)}}));
  };
  EXPECT_TRUE(crossing(0.0));
  EXPECT_TRUE(crossing(3.0));
  EXPECT_FALSE(crossing(12.0));
}

TEST(JointCombinationsTest, ShapesAreRectanglesAlongTheMotion) {
  const auto apart = [](double x, double y, double heading) {
    return Exclude(Car(1, {0.0, 0.0, 0.0}, {{1.0, Straight(5.0)}}),
                   Car(2, {x, y, heading}, {{1.0, Straight(5.0)}}));
  };
  // One behind the other, at the same speed: 4.6 m long.
  EXPECT_FALSE(apart(4.61, 0.0, 0.0));
  // Side by side: 2 m wide.
  EXPECT_FALSE(apart(0.0, 2.01, 0.0));
  // A faster one comes within the width; the same 2.01 m beside it does not.
  const auto passes = [](double y) {
    return Exclude(Car(1, {0.0, 0.0, 0.0}, {{1.0, Straight(2.0)}}),
                   Car(2, {-10.0, y, 0.0}, {{1.0, Straight(9.0)}}));
  };
  EXPECT_TRUE(passes(1.99));
  EXPECT_FALSE(passes(2.01));
  // Stops behind a standing car: the ends are where the length says.
  const auto stops = [](double distance) {
    return Exclude(Car(1, {0.0, 0.0, 0.0}, {{1.0, Straight(2.0)}}),
                   Car(2, {distance, 0.0, 0.0}, {{1.0, Straight(0.0)}}));
  };
  EXPECT_TRUE(stops(10.0 + 4.59));
  EXPECT_FALSE(stops(10.0 + 4.61));
  // A lorry is as long in the middle as at its ends.
  JointTarget lorry = Car(3, {0.0, 0.0, M_PI / 2}, {{1.0, Straight(0.0)}});
  lorry.length = 16.0;
  for (const double along : {-6.9, -3.5, 0.0, 3.5, 6.9}) {
    const JointTarget car = Car(4, {-20.0, along, 0.0}, {{1.0, Straight(8.0)}});
    EXPECT_TRUE(Exclude(lorry, car)) << along;
  }
  EXPECT_FALSE(Exclude(lorry, Car(4, {-20.0, 9.1, 0.0}, {{1.0, Straight(8.0)}})));
}

// Corners of a rectangle, counter-clockwise.
std::vector<scene::Point2> Corners(const scene::Pose2& pose, double length, double width) {
  return {pose * scene::Point2{length / 2, width / 2}, pose * scene::Point2{-length / 2, width / 2},
          pose * scene::Point2{-length / 2, -width / 2},
          pose * scene::Point2{length / 2, -width / 2}};
}

// > 0 if c is to the left of the way from a to b.
double Side(const scene::Point2& a, const scene::Point2& b, const scene::Point2& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// By other means: a corner of one lies in the other, or two sides cross.
bool RectanglesOverlap(const std::vector<scene::Point2>& a, const std::vector<scene::Point2>& b) {
  const auto holds = [](const std::vector<scene::Point2>& sides, const scene::Point2& p) {
    bool inside = true;
    for (size_t i = 0; i < 4; ++i) inside &= Side(sides[i], sides[(i + 1) % 4], p) > 0.0;
    return inside;
  };
  bool overlap = false;
  for (size_t i = 0; i < 4; ++i) {
    overlap |= holds(a, b[i]) || holds(b, a[i]);
    const scene::Point2& from = a[i];
    const scene::Point2& to = a[(i + 1) % 4];
    for (size_t j = 0; j < 4; ++j) {
      const scene::Point2& start = b[j];
      const scene::Point2& end = b[(j + 1) % 4];
      overlap |= Side(from, to, start) * Side(from, to, end) < 0.0 &&
                 Side(start, end, from) * Side(start, end, to) < 0.0;
    }
  }
  return overlap;
}

TEST(JointCombinationsTest, RectanglesOverlapWhereTheirCornersSaySo) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit;
  int overlaps = 0;
  for (int n = 0; n < 2000; ++n) {
    // Each comes from 100 m away in one step, so that only its place after that counts.
    std::vector<JointTarget> targets;
    std::vector<std::vector<scene::Point2>> corners;
    for (int i = 0; i < 2; ++i) {
      const double heading = 2.0 * M_PI * unit(random);
      const double x = i * 8.0 * (unit(random) - 0.5);
      const double y = i * 8.0 * (unit(random) - 0.5);
      targets.push_back(Car(i,
                            {x - 100.0 * std::cos(heading), y - 100.0 * std::sin(heading), heading},
                            {{1.0, Straight(1000.0, 1, 0.1)}}));
      targets.back().length = 1.0 + 6.0 * unit(random);
      targets.back().width = 0.5 + 2.5 * unit(random);
      corners.push_back(Corners({x, y, heading}, targets.back().length, targets.back().width));
    }
    const bool expected = RectanglesOverlap(corners[0], corners[1]);
    if (RectanglesOverlap(Corners(targets[0].X_WT, targets[0].length, targets[0].width),
                          Corners(targets[1].X_WT, targets[1].length, targets[1].width))) {
      continue;
    }
    overlaps += expected ? 1 : 0;
    EXPECT_EQ(Exclude(targets[0], targets[1], 0.1), expected) << n;
  }
  EXPECT_GT(overlaps, 400);
}

// At each time that is looked at, the ends of both are 1.5 m or more from the other.
TEST(JointCombinationsTest, LongTargetsThatLieAcrossEachOtherOverlap) {
  JointTarget standing = Car(1, {0.0, 0.0, M_PI / 2}, {{1.0, Straight(0.0)}});
  JointTarget crossing = Car(2, {-39.0, 0.0, 0.0}, {{1.0, Straight(30.0)}});
  for (JointTarget* target : {&standing, &crossing}) {
    target->length = 16.0;
    target->width = 1.0;
  }
  EXPECT_TRUE(Exclude(standing, crossing));
}

TEST(JointCombinationsTest, ATargetThatHardlyMovesKeepsItsHeading) {
  // It drifts 0.25 m to its side, and would otherwise lie across the road of the other.
  Trajectory drift(kWaypoints, 2);
  for (Eigen::Index t = 0; t < kWaypoints; ++t) {
    drift(t, 0) = 0.0;
    drift(t, 1) = 0.025 * static_cast<double>(t + 1);
  }
  const JointTarget standing = Car(1, {0.0, 0.0, 0.0}, {{1.0, drift}});
  EXPECT_FALSE(Exclude(standing, Car(2, {-20.0, -2.1, 0.0}, {{1.0, Straight(8.0)}})));
}

TEST(JointCombinationsTest, TargetsThatOverlapAtThePredictionTimeDoNotExcludeEachOther) {
  const std::vector<Action> actions = {{0.7, Straight(6.0)}, {0.3, Straight(5.0)}};
  const JointTarget car = Car(1, {0.0, 0.0, 0.0}, actions);
  const JointTarget near = Car(2, {4.0, 0.5, 0.0}, actions);
  EXPECT_THAT(CombineActions(std::vector{car, near}, kInterval, 9).combinations, SizeIs(4));
  // The one ahead of both is excluded nevertheless.
  const JointTarget ahead = Car(3, {30.0, 0.0, 0.0}, {{1.0, Straight(0.0)}});
  EXPECT_THAT(CombineActions(std::vector{car, near, ahead}, kInterval, 9).combinations, IsEmpty());
}

TEST(JointCombinationsTest, TheSearchEndsAtItsBoundAndSaysSo) {
  const std::vector<JointTarget> targets = RandomTargets(4, 5, 1);
  const JointCombinations whole = CombineActions(targets, kInterval, 30);
  ASSERT_THAT(whole.combinations, SizeIs(30));
  const JointCombinations some = CombineActions(targets, kInterval, 30, 12);
  EXPECT_TRUE(some.truncated);
  ASSERT_LT(some.combinations.size(), 30u);
  ASSERT_FALSE(some.combinations.empty());
  for (size_t n = 0; n < some.combinations.size(); ++n) {
    EXPECT_EQ(some.combinations[n].actions, whole.combinations[n].actions);
  }
}

// Otherwise 12^8 ties would be searched.
TEST(JointCombinationsTest, EquallyProbableActionsDoNotExhaustTheSearch) {
  std::vector<Action> alike;
  alike.reserve(12);
  for (int a = 0; a < 12; ++a) alike.push_back({1.0 / 12, Straight(0.1 * a)});
  std::vector<JointTarget> targets;
  targets.reserve(8);
  for (int i = 0; i < 8; ++i) targets.push_back(Car(i, {20.0 * i, 0.0, 0.0}, alike));
  const JointCombinations answer = CombineActions(targets, kInterval, 64);
  EXPECT_THAT(answer.combinations, SizeIs(64));
  EXPECT_FALSE(answer.truncated);
  for (const JointCombination& each : answer.combinations)
    EXPECT_NEAR(each.weight, 1 / 64.0, 1e-12);
}

TEST(JointCombinationsTest, TheMostProbableActionsTakePart) {
  Eigen::VectorXd probabilities = Eigen::VectorXd::Constant(20, 0.9e-4);
  probabilities[7] = 0.3;
  probabilities[3] = 0.3;
  probabilities[9] = 0.4;
  EXPECT_THAT(JointActions(probabilities), ElementsAre(9, 3, 7));
  EXPECT_THAT(JointActions(Eigen::VectorXd::Constant(20, 0.05)), SizeIs(kMostJointActions));
}

TEST(JointCombinationsTest, NumbersBeyondMeasureEndTheSearchToo) {
  const auto at = [](double x) {
    return Car(x < 0 ? 1 : 2, {x, 0.0, 0.0}, {{0.6, Straight(1e300)}, {0.4, Straight(1.0)}});
  };
  EXPECT_LE(CombineActions(std::vector{at(-1e300), at(1e300)}, kInterval, 6).combinations.size(),
            4u);
}

}  // namespace
}  // namespace maneuver::inference::joint_combinations_test
