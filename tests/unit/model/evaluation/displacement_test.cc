#include "model/evaluation/displacement.h"

#include <gtest/gtest.h>

#include <vector>

namespace maneuver::evaluation::displacement_test {
namespace {

Trajectory Line(double y, std::initializer_list<double> x) {
  Trajectory trajectory(x.size(), 2);
  int t = 0;
  for (const double value : x) trajectory.row(t++) << value, y;
  return trajectory;
}

TEST(DisplacementTest, AdeAveragesDistancesAndFdeTakesTheLast) {
  const Trajectory truth = Line(0.0, {1.0, 2.0, 3.0});
  Trajectory predicted = truth;
  predicted.row(1) += Eigen::RowVector2d(3.0, 4.0);   // 5 m off
  predicted.row(2) += Eigen::RowVector2d(0.0, -1.0);  // 1 m off
  EXPECT_DOUBLE_EQ(AverageDisplacement(predicted, truth), 2.0);
  EXPECT_DOUBLE_EQ(FinalDisplacement(predicted, truth), 1.0);
}

TEST(DisplacementTest, BestOfUsesTheFirstKAndMinimisesEachErrorSeparately) {
  const Trajectory truth = Line(0.0, {0.0, 0.0});
  const std::vector<Trajectory> ranked = {
      Line(0.0, {9.0, 9.0}),   // ADE 9, FDE 9
      Line(0.0, {0.0, 4.0}),   // ADE 2, FDE 4
      Line(0.0, {10.0, 3.0}),  // ADE 6.5, FDE 3
      Line(0.0, {0.0, 0.0}),
  };
  const std::vector<double> probabilities = {0.4, 0.3, 0.2, 0.1};
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 1, truth).min_ade, 9.0);
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 3, truth).min_ade, 2.0);
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 3, truth).min_fde, 3.0);
  EXPECT_TRUE(BestOf(ranked, probabilities, 3, truth).missed_argoverse);
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 10, truth).min_ade, 0.0);
  EXPECT_FALSE(BestOf(ranked, probabilities, 10, truth).missed_argoverse);
}

TEST(DisplacementTest, ArgoverseMissesBeyondTwoMetresAtTheEnd) {
  const Trajectory truth = Line(0.0, {0.0, 0.0});
  EXPECT_FALSE(ErrorsOf(Line(2.0, {0.0, 0.0}), truth).missed_argoverse);
  EXPECT_TRUE(ErrorsOf(Line(2.001, {0.0, 0.0}), truth).missed_argoverse);
  EXPECT_FALSE(ErrorsOf(Line(0.0, {50.0, 0.0}), truth).missed_argoverse);
}

TEST(DisplacementTest, NuScenesMissesAtAnyWaypointFromTwoMetres) {
  const Trajectory truth = Line(0.0, {0.0, 0.0});
  EXPECT_FALSE(ErrorsOf(Line(1.999, {0.0, 0.0}), truth).missed_nuscenes);
  EXPECT_TRUE(ErrorsOf(Line(2.0, {0.0, 0.0}), truth).missed_nuscenes);
  EXPECT_TRUE(ErrorsOf(Line(0.0, {3.0, 0.0}), truth).missed_nuscenes);
}

// One prediction must stay near throughout. Two that do so in turn are both misses.
TEST(DisplacementTest, ANuScenesHitNeedsOnePredictionThatStaysNear) {
  const Trajectory truth = Line(0.0, {0.0, 0.0});
  const std::vector<Trajectory> ranked = {Line(0.0, {0.0, 3.0}), Line(0.0, {3.0, 0.0}),
                                          Line(0.0, {1.0, 1.0})};
  const std::vector<double> probabilities = {0.5, 0.3, 0.2};
  EXPECT_TRUE(BestOf(ranked, probabilities, 2, truth).missed_nuscenes);
  EXPECT_FALSE(BestOf(ranked, probabilities, 3, truth).missed_nuscenes);
}

// Argoverse 2: the best by FDE has 0.3 of the 0.8 that the first two share.
TEST(DisplacementTest, BrierFdePenalisesALowProbabilityOfTheBest) {
  const Trajectory truth = Line(0.0, {0.0});
  const std::vector<Trajectory> ranked = {Line(0.0, {4.0}), Line(0.0, {1.0}), Line(0.0, {6.0})};
  const std::vector<double> probabilities = {0.5, 0.3, 0.2};
  const double doubt = 1.0 - 0.3 / 0.8;
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 2, truth).brier_fde, 1.0 + doubt * doubt);
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 3, truth).brier_fde, 1.0 + 0.7 * 0.7);
  EXPECT_DOUBLE_EQ(BestOf(ranked, probabilities, 1, truth).brier_fde, 4.0);
}

}  // namespace
}  // namespace maneuver::evaluation::displacement_test
