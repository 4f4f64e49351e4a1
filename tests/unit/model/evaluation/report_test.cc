#include "model/evaluation/report.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/model/evaluation/report_of.h"

namespace maneuver::evaluation::report_test {
namespace {

// Returns an example of action `action` of two, with ADE 1 for every rank and density.
Measurement Example(int action, double confidence) {
  Measurement measured;
  measured.action = action;
  measured.probabilities.resize(2);
  measured.probabilities << confidence, 1.0 - confidence;
  measured.responsibilities = Eigen::VectorXd::Zero(2);
  measured.responsibilities[action] = 1.0;
  for (size_t rank = 0; rank < kRanks.size(); ++rank) {
    measured.posterior.displacement[rank] = {.min_ade = 1.0, .min_fde = 2.0, .brier_fde = 2.5};
    measured.prior.displacement[rank] = {.min_ade = 3.0, .min_fde = 4.0};
    measured.cover[rank] = {.min_ade = 0.75, .min_fde = 1.5};
    measured.waymo[rank] = {.min_ade = 0.5, .min_fde = 0.75, .miss_rate = 0.5};
  }
  measured.constant_velocity.displacement = {.min_ade = 2.0, .min_fde = 8.0};
  measured.constant_turn.displacement = {.min_ade = 5.0, .min_fde = 6.0};
  measured.faded.displacement = {.min_ade = 1.75, .min_fde = 3.5};
  measured.faded.waymo = {.min_ade = 0.25};
  return measured;
}

TEST(ReportTest, MetricsAreMeansUnderTheirNames) {
  std::vector<Measurement> measured = {Example(0, 0.9), Example(1, 0.7)};
  measured[1].posterior.displacement[0].min_ade = 2.0;
  measured[1].posterior.displacement[2].missed_argoverse = true;
  measured[1].posterior.displacement[3].missed_nuscenes = true;
  measured[0].posterior.nll = {1.0, 10.0};
  measured[0].prior.nll = {2.0, 20.0};
  measured[0].prior.action_nll = 6.0;
  measured[0].posterior.envelope = {{0.2, 0.4}, {0.6, 0.8}, 3.0};
  measured[0].prior.envelope = {{0.4, 0.6}, {0.8, 1.0}, 4.0};
  measured[0].waymo[1].miss_rate = 1.0;
  measured[0].cover[0].min_ade = 1.25;
  measured[1].cover[2].min_ade = 0.25;
  measured[1].cover[2].missed_argoverse = true;
  const auto metrics = ReportOf(measured, true).metrics();
  EXPECT_DOUBLE_EQ(metrics.at("ade_1"), 1.5);
  EXPECT_DOUBLE_EQ(metrics.at("min_ade_5"), 1.0);
  EXPECT_DOUBLE_EQ(metrics.at("min_fde_10"), 2.0);
  EXPECT_DOUBLE_EQ(metrics.at("min_ade_6_prior"), 3.0);
  EXPECT_DOUBLE_EQ(metrics.at("fde_1_prior"), 4.0);
  EXPECT_DOUBLE_EQ(metrics.at("brier_fde_6"), 2.5);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_5"), 0.0);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_6"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_nuscenes_10"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_waymo_5"), 0.75);
  EXPECT_DOUBLE_EQ(metrics.at("min_ade_waymo_6"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("fde_waymo_1"), 0.75);
  EXPECT_DOUBLE_EQ(metrics.at("ade_medoid"), 1.0);
  EXPECT_DOUBLE_EQ(metrics.at("fde_medoid"), 1.5);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_medoid"), 0.0);
  EXPECT_DOUBLE_EQ(metrics.at("ade_medoid_ratio"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("fde_medoid_ratio"), 0.1875);
  EXPECT_DOUBLE_EQ(metrics.at("min_ade_cover_5"), 0.75);
  EXPECT_DOUBLE_EQ(metrics.at("min_ade_cover_6"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("min_fde_cover_10"), 1.5);
  EXPECT_DOUBLE_EQ(metrics.at("miss_rate_cover_6"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("ade_faded"), 1.75);
  EXPECT_DOUBLE_EQ(metrics.at("fde_faded"), 3.5);
  EXPECT_DOUBLE_EQ(metrics.at("ade_waymo_faded"), 0.25);
  EXPECT_DOUBLE_EQ(metrics.at("ade_cv"), 2.0);
  EXPECT_DOUBLE_EQ(metrics.at("fde_ctra"), 6.0);
  EXPECT_DOUBLE_EQ(metrics.at("ade_ratio"), 0.75);
  EXPECT_DOUBLE_EQ(metrics.at("min_fde_6_ratio"), 0.25);
  EXPECT_DOUBLE_EQ(metrics.at("nll"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("nll_joint"), 5.0);
  EXPECT_DOUBLE_EQ(metrics.at("nll_prior"), 1.0);
  EXPECT_DOUBLE_EQ(metrics.at("nll_action"), 0.0);
  EXPECT_DOUBLE_EQ(metrics.at("nll_action_prior"), 3.0);
  EXPECT_DOUBLE_EQ(metrics.at("coverage_1sigma"), 0.1);
  EXPECT_DOUBLE_EQ(metrics.at("coverage_2sigma_latent"), 0.4);
  EXPECT_DOUBLE_EQ(metrics.at("coverage_2sigma_latent_prior"), 0.5);
  EXPECT_DOUBLE_EQ(metrics.at("mean_sigma_ratio"), 0.75);
  EXPECT_DOUBLE_EQ(metrics.at("largest_share"), 0.8);
}

TEST(ReportTest, ShortHorizonsHaveNoWaymoMetrics) {
  const std::vector<Measurement> measured = {Example(0, 0.9)};
  const v1::EvaluationReport report = ReportOf(measured, false);
  for (const auto& [name, _] : report.metrics()) {
    EXPECT_EQ(name.find("waymo"), std::string::npos) << name;
  }
}

TEST(ReportTest, ReliabilityCountsEveryExampleInItsBin) {
  const std::vector<Measurement> measured = {Example(0, 0.92), Example(1, 0.98), Example(0, 0.6)};
  const v1::EvaluationReport report = ReportOf(measured, true);
  ASSERT_EQ(report.reliability_size(), 10);
  const v1::ReliabilityBin& last = report.reliability(9);
  EXPECT_DOUBLE_EQ(last.lower(), 0.9);
  EXPECT_EQ(last.examples(), 2);
  EXPECT_DOUBLE_EQ(last.mean_confidence(), 0.95);
  EXPECT_DOUBLE_EQ(last.mean_responsibility(), 0.5);
  EXPECT_EQ(report.reliability(6).examples(), 1);
  EXPECT_EQ(report.reliability(0).examples(), 0);
}

TEST(ReportTest, StrataPartitionTheExamplesAndAreMeasuredSeparately) {
  std::vector<Measurement> measured = {Example(0, 0.9), Example(1, 0.9), Example(1, 0.9)};
  measured[0].keys = {.agents = 5, .speed = 7.0, .heading_change = 0.0};
  measured[1].keys = {.agents = 50, .speed = 7.0, .heading_change = 1.0};
  measured[2].keys = {.agents = 5, .speed = 0.0, .heading_change = 0.0};
  measured[1].posterior.displacement[0].min_ade = 9.0;
  const v1::EvaluationReport report = ReportOf(measured, true);
  std::map<std::string, int64_t> sizes;
  for (const v1::EvaluationStratum& stratum : report.strata()) {
    sizes[stratum.dimension()] += stratum.examples();
    EXPECT_EQ(stratum.metrics().empty(), stratum.examples() == 0) << stratum.name();
    if (stratum.name() == "left" || stratum.name() == "31-60") {
      EXPECT_EQ(stratum.examples(), 1);
      EXPECT_DOUBLE_EQ(stratum.metrics().at("ade_1"), 9.0);
    }
    if (stratum.name() == "5-10 m/s") {
      EXPECT_DOUBLE_EQ(stratum.metrics().at("ade_medoid"), 0.75);
      EXPECT_DOUBLE_EQ(stratum.metrics().at("min_ade_cover_6"), 0.75);
      EXPECT_DOUBLE_EQ(stratum.metrics().at("ade_faded"), 1.75);
      EXPECT_DOUBLE_EQ(stratum.metrics().at("ade_1"), 5.0);
    }
    if (stratum.name() == "straight") {
      // One of two examples was the action that had 0.9.
      EXPECT_DOUBLE_EQ(stratum.metrics().at("calibration_error"), 0.4);
    }
  }
  EXPECT_EQ(sizes, (std::map<std::string, int64_t>{
                       {"agents", 3}, {"class", 3}, {"speed", 3}, {"turn", 3}, {"type", 3}}));
}

TEST(ReportTest, NamesActionsByTheirMostFrequentClass) {
  std::vector<Measurement> measured = {Example(0, 0.9), Example(0, 0.9), Example(0, 0.9)};
  measured[0].keys.kinematic_class = KinematicClass::kLeftTurn;
  measured[2].keys.kinematic_class = KinematicClass::kLeftTurn;
  measured[1].relative_class = RelativeClass::kBrakes;
  measured[2].relative_class = RelativeClass::kBrakes;
  const v1::EvaluationReport report = ReportOf(measured, true);
  ASSERT_EQ(report.action_uses_size(), 2);
  EXPECT_EQ(report.action_uses(0).examples(), 3);
  EXPECT_EQ(report.action_uses(0).kinematic_class(), "left_turn");
  EXPECT_DOUBLE_EQ(report.action_uses(0).class_share(), 2.0 / 3.0);
  EXPECT_EQ(report.action_uses(0).relative_class(), "brakes");
  EXPECT_DOUBLE_EQ(report.action_uses(0).relative_class_share(), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(report.metrics().at("purity_relative"), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(report.action_uses(0).probability(), 0.9);
  EXPECT_EQ(report.action_uses(1).examples(), 0);
  EXPECT_EQ(report.action_uses(1).kinematic_class(), "");
}

}  // namespace
}  // namespace maneuver::evaluation::report_test
