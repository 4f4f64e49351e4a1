#include "model/evaluation/calibration.h"

#include <gtest/gtest.h>

#include <cmath>

namespace maneuver::evaluation::calibration_test {
namespace {

Eigen::VectorXd Vector(std::initializer_list<double> values) {
  Eigen::VectorXd vector(values.size());
  int i = 0;
  for (const double value : values) vector[i++] = value;
  return vector;
}

TEST(ActionStatisticsTest, CertainAndDifferentPredictionsHaveFullInformation) {
  ActionStatistics statistics(3);
  statistics.Add(Vector({1.0, 0.0, 0.0}), Vector({1.0, 0.0, 0.0}));
  statistics.Add(Vector({0.0, 1.0, 0.0}), Vector({0.0, 1.0, 0.0}));
  EXPECT_NEAR(statistics.MutualInformation(), std::log(2.0), 1e-12);
  EXPECT_NEAR(statistics.Perplexity(), 2.0, 1e-12);
  EXPECT_EQ(statistics.EffectiveActions(), 2);
  EXPECT_NEAR(statistics.ExpectedCalibrationError(), 0.0, 1e-12);
}

TEST(ActionStatisticsTest, PredictionsThatIgnoreTheSceneHaveNoInformation) {
  ActionStatistics statistics(2);
  for (int i = 0; i < 4; ++i) statistics.Add(Vector({0.25, 0.75}), Vector({0.0, 1.0}));
  EXPECT_NEAR(statistics.MutualInformation(), 0.0, 1e-12);
  EXPECT_NEAR(statistics.MeanProbability()[1], 0.75, 1e-12);
  // Predicted 0.75, right every time.
  EXPECT_NEAR(statistics.ExpectedCalibrationError(), 0.25, 1e-12);
}

TEST(ActionStatisticsTest, OneExampleAtFivePercentMakesAnActionEffective) {
  ActionStatistics statistics(3);
  statistics.Add(Vector({0.95, 0.05, 0.0}), Vector({1.0, 0.0, 0.0}));
  statistics.Add(Vector({0.951, 0.0, 0.049}), Vector({1.0, 0.0, 0.0}));
  EXPECT_EQ(statistics.EffectiveActions(), 2);
}

// Errors of opposite sign cancel within a bin but not between bins.
TEST(ActionStatisticsTest, CalibrationIsMeasuredBinByBin) {
  ActionStatistics statistics(2);
  statistics.Add(Vector({0.62, 0.38}), Vector({1.0, 0.0}));
  statistics.Add(Vector({0.62, 0.38}), Vector({0.24, 0.76}));
  EXPECT_NEAR(statistics.ExpectedCalibrationError(), 0.0, 1e-12);
  statistics.Add(Vector({0.95, 0.05}), Vector({0.0, 1.0}));
  EXPECT_NEAR(statistics.ExpectedCalibrationError(), 0.95 / 3.0, 1e-12);
}

TEST(ActionStatisticsTest, BinsCountTheMostProbableActionAndItsResponsibility) {
  ActionStatistics statistics(2);
  statistics.Add(Vector({0.62, 0.38}), Vector({1.0, 0.0}));
  statistics.Add(Vector({0.34, 0.66}), Vector({0.75, 0.25}));
  statistics.Add(Vector({1.0, 0.0}), Vector({0.9, 0.1}));  // 1 belongs to the last bin
  EXPECT_EQ(statistics.bins()[6].examples, 2);
  EXPECT_NEAR(statistics.bins()[6].confidence, 0.62 + 0.66, 1e-12);
  EXPECT_NEAR(statistics.bins()[6].responsibility, 1.25, 1e-12);
  EXPECT_EQ(statistics.bins()[9].examples, 1);
  EXPECT_EQ(statistics.bins()[5].examples, 0);
}

TEST(ActionStatisticsTest, AveragesTheEntropyOfEachPrediction) {
  ActionStatistics statistics(2);
  statistics.Add(Vector({0.5, 0.5}), Vector({1.0, 0.0}));
  statistics.Add(Vector({1.0, 0.0}), Vector({1.0, 0.0}));
  EXPECT_NEAR(statistics.MeanEntropy(), 0.5 * std::log(2.0), 1e-12);
}

}  // namespace
}  // namespace maneuver::evaluation::calibration_test
