#include "model/evaluation/metric_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/unit/model/evaluation/report_of.h"

namespace maneuver::evaluation::metric_table_test {
namespace {

TEST(MetricTableTest, KnowsEachMetricOfAReport) {
  // Two actions, one waypoint.
  Measurement measured;
  measured.probabilities = Eigen::Vector2d(0.75, 0.25);
  measured.responsibilities = Eigen::Vector2d(0.5, 0.5);
  measured.maneuver = 0;
  measured.constant_velocity.displacement.min_ade = 1.0;  // for the ratios
  measured.constant_velocity.displacement.min_fde = 1.0;
  measured.posterior.envelope.mean_sigma = measured.prior.envelope.mean_sigma = 1.0;
  measured.covernet.emplace().probabilities = Eigen::Vector2d(0.5, 0.5);
  measured.multipath = measured.covernet;
  const v1::EvaluationReport report = ReportOf({&measured, 1}, /*measured_by_waymo=*/true);
  EXPECT_GT(report.metrics_size(), 60);
  for (const auto& [name, _] : report.metrics()) EXPECT_TRUE(FindMetric(name)) << name;
  EXPECT_FALSE(FindMetric("something_new"));
  EXPECT_FALSE(FindMetric(""));
}

TEST(MetricTableTest, LowerErrorsAndHigherAgreementAreBetter) {
  for (const char* name : {"ade_1", "min_ade_6", "min_fde_10", "brier_fde_5", "miss_rate_waymo_6",
                           "nll", "nll_joint_prior", "min_ade_6_ratio", "calibration_error",
                           "ade_medoid", "min_fde_cover_6", "ade_medoid_ratio"}) {
    EXPECT_EQ(FindMetric(name)->better, Better::kLower) << name;
  }
  for (const char* name : {"nmi", "purity_kinematic", "class_information_relative"}) {
    EXPECT_EQ(FindMetric(name)->better, Better::kHigher) << name;
  }
  for (const char* name : {"effective_actions", "mean_sigma_prior", "mutual_information"}) {
    EXPECT_EQ(FindMetric(name)->better, Better::kNone) << name;
    EXPECT_FALSE(CanDecide(name)) << name;
  }
  EXPECT_EQ(FindMetric("min_ade_6")->unit, "m");
  EXPECT_EQ(FindMetric("nll")->unit, "nats");
  EXPECT_EQ(FindMetric("miss_rate_6")->unit, "share");
  EXPECT_EQ(FindMetric("ade_medoid")->unit, "m");
  EXPECT_EQ(FindMetric("miss_rate_cover_6")->unit, "share");
  EXPECT_TRUE(CanDecide("min_ade_6"));
  EXPECT_FALSE(CanDecide("no_such"));
}

TEST(MetricTableTest, MetricsOfBaselinesCannotDecide) {
  for (const char* name :
       {"ade_cv", "miss_rate_waymo_ctra", "fde_faded", "covernet_nll", "multipath_ade_1"}) {
    ASSERT_TRUE(FindMetric(name)) << name;
    EXPECT_FALSE(FindMetric(name)->of_model) << name;
    EXPECT_EQ(FindMetric(name)->better, Better::kNone) << name;
  }
  EXPECT_TRUE(FindMetric("nll_prior")->of_model);
}

TEST(MetricTableTest, JudgesByDirectionToleranceAndNearness) {
  const MetricInfo lower = *FindMetric("nll");
  EXPECT_EQ(Judge(lower, 2.0, 1.5, 0.0), v1::METRIC_VERDICT_BETTER);
  EXPECT_EQ(Judge(lower, 2.0, 2.0, 0.0), v1::METRIC_VERDICT_NO_WORSE);
  EXPECT_EQ(Judge(lower, 2.0, 2.25, 0.0), v1::METRIC_VERDICT_WORSE);
  EXPECT_EQ(Judge(lower, 2.0, 2.25, 0.25), v1::METRIC_VERDICT_NO_WORSE);
  EXPECT_EQ(Judge(lower, 2.0, 2.5, 0.25), v1::METRIC_VERDICT_WORSE);
  EXPECT_EQ(Judge(lower, -1.0, -0.5, 0.0), v1::METRIC_VERDICT_WORSE);

  const MetricInfo higher = *FindMetric("nmi");
  EXPECT_EQ(Judge(higher, 0.5, 0.75, 0.0), v1::METRIC_VERDICT_BETTER);
  EXPECT_EQ(Judge(higher, 0.5, 0.25, 0.125), v1::METRIC_VERDICT_WORSE);
  EXPECT_EQ(Judge(higher, 0.5, 0.25, 0.25), v1::METRIC_VERDICT_NO_WORSE);

  // 86.5 % of a Gaussian in the plane lies within 2 sigma: too much is as bad as too little.
  const MetricInfo nearer = *FindMetric("coverage_2sigma");
  EXPECT_NEAR(nearer.ideal, 1.0 - std::exp(-2.0), 1e-15);
  EXPECT_NEAR(FindMetric("coverage_1sigma")->ideal, 1.0 - std::exp(-0.5), 1e-15);
  EXPECT_EQ(Judge(nearer, 0.95, 0.85, 0.0), v1::METRIC_VERDICT_BETTER);
  EXPECT_EQ(Judge(nearer, 0.85, 0.95, 0.0), v1::METRIC_VERDICT_WORSE);
  EXPECT_EQ(Judge(nearer, 0.85, 0.75, 0.0), v1::METRIC_VERDICT_WORSE);

  EXPECT_EQ(Judge(*FindMetric("action_entropy"), 1.0, 2.0, 0.0), v1::METRIC_VERDICT_UNSPECIFIED);
}

TEST(MetricTableTest, ValuesThatAreNotFiniteAreWorse) {
  const MetricInfo nll = *FindMetric("nll");
  for (const double no_number : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    EXPECT_EQ(Judge(nll, 1.0, no_number, 100.0), v1::METRIC_VERDICT_WORSE);
    EXPECT_EQ(Judge(nll, no_number, no_number, 100.0), v1::METRIC_VERDICT_WORSE);
    EXPECT_EQ(Judge(nll, no_number, 1.0, 0.0), v1::METRIC_VERDICT_BETTER);
  }
}

}  // namespace
}  // namespace maneuver::evaluation::metric_table_test
