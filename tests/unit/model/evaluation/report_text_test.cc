#include "model/evaluation/report_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maneuver::evaluation::report_text_test {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(ReportTextTest, ShowsAccuracyBesideTheBaselines) {
  v1::EvaluationReport report;
  auto& metrics = *report.mutable_metrics();
  metrics["ade_1"] = 1.25;
  metrics["min_ade_6"] = 0.5;
  metrics["ade_cv"] = 2.0;
  metrics["ade_ctra"] = 12.5;
  metrics["miss_rate_6"] = 0.4321;
  metrics["min_ade_6_prior"] = 0.75;
  EXPECT_EQ(ReportText(report, false),
            "ACCURACY             k = 1   k = 6    CV   CTRA\n"
            "minADE, m             1.25    0.50  2.00  12.50\n"
            "missed, Argoverse 2         43.2 %\n"
            "generic minADE, m             0.75\n");
}

TEST(ReportTextTest, ShowsMedoidAndRepresentativesBelowTheMostProbable) {
  v1::EvaluationReport report;
  auto& metrics = *report.mutable_metrics();
  metrics["ade_1"] = 1.25;
  metrics["ade_faded"] = 2.5;
  metrics["ade_medoid"] = 1.125;
  metrics["min_ade_cover_6"] = 0.25;
  metrics["miss_rate_cover_6"] = 0.5;
  metrics["ade_medoid_ratio"] = 0.5;
  EXPECT_EQ(ReportText(report, false),
            "ACCURACY                              k = 1   k = 6  FADED\n"
            "minADE, m                              1.25           2.50\n"
            "medoid, covering minADE, m             1.12    0.25\n"
            "medoid, covering missed, Argoverse 2         50.0 %\n"
            "medoid's ADE by ADE of CV             0.500\n");
}

TEST(ReportTextTest, UnknownMetricsFollowByName) {
  v1::EvaluationReport report;
  (*report.mutable_metrics())["nll"] = 1.8;
  (*report.mutable_metrics())["something_new"] = 0.125;
  EXPECT_EQ(ReportText(report, false),
            "LIKELIHOOD (-ln p, nats)  MODEL\n"
            "mixture, a waypoint       1.800\n"
            "\n"
            "OTHER          VALUE\n"
            "something_new  0.125\n");
}

TEST(ReportTextTest, ShowsTrainedBaselinesBesideTheModelAndTheSimpleOnes) {
  v1::EvaluationReport report;
  report.set_examples(3);
  auto& metrics = *report.mutable_metrics();
  metrics["nll"] = 1.5;
  metrics["covernet_nll"] = 3.25;
  metrics["multipath_nll"] = 1.75;
  metrics["covernet_ade_1"] = 3.0;
  metrics["ade_cv"] = 2.0;
  const std::string text = ReportText(report, false);
  EXPECT_THAT(text, HasSubstr("BASELINES             MODEL  COVERNET-LIKE  MULTIPATH-LIKE    CV\n"
                              "ADE, m                                3.00                  2.00\n"
                              "NLL a waypoint, nats  1.500          3.250           1.750\n"));
  EXPECT_THAT(text, Not(HasSubstr("OTHER")));
  EXPECT_THAT(text, Not(HasSubstr("--baselines")));
}

TEST(ReportTextTest, AnEvaluationWithoutTrainedBaselinesSaysHowToGetThem) {
  v1::EvaluationReport report;
  (*report.mutable_metrics())["ade_cv"] = 2.0;
  EXPECT_THAT(ReportText(report, false), Not(HasSubstr("baselines")));  // a manifest's metrics
  report.set_examples(3);
  EXPECT_THAT(ReportText(report, false), HasSubstr("maneuver train --set baselines=true"));
}

TEST(ReportTextTest, ShowsCoverageBesideThatOfAGaussian) {
  v1::EvaluationReport report;
  auto& metrics = *report.mutable_metrics();
  metrics["coverage_2sigma"] = 0.9;
  metrics["coverage_2sigma_prior"] = 0.95;
  EXPECT_EQ(ReportText(report, false),
            "ENVELOPE                   MODEL  GENERIC  GAUSSIAN\n"
            "holds the truth, 2 sigma  90.0 %   95.0 %    86.5 %\n");
}

TEST(ReportTextTest, MeaningHasAColumnForEachKindOfClasses) {
  v1::EvaluationReport report;
  auto& metrics = *report.mutable_metrics();
  metrics["mutual_information"] = 1.25;
  metrics["nmi_kinematic"] = 0.25;
  metrics["nmi_relative"] = 0.5;
  metrics["purity_kinematic"] = 0.625;
  metrics["purity_relative"] = 0.75;
  metrics["class_information_kinematic"] = 0.6;
  metrics["class_information_relative"] = 0.5;
  metrics["named_share_relative"] = 0.3;
  metrics["named_share_motion"] = 0.6;
  EXPECT_EQ(ReportText(report, false),
            "ACTIONS       VALUE\n"
            "I(y;s), nats  1.250\n"
            "\n"
            "MEANING                             KINEMATIC  RELATIVE\n"
            "NMI of action and class                 0.250     0.500\n"
            "purity of the actions                   0.625     0.750\n"
            "class information, given the speed     60.0 %    50.0 %\n"
            "examples in actions of purity 0.7                30.0 %\n"
            "the same, standing as keeping                    60.0 %\n");
  metrics["nmi"] = 0.375;
  metrics["labelled_examples"] = 7;
  EXPECT_THAT(ReportText(report, false),
              HasSubstr("MEANING                             KINEMATIC  RELATIVE  RECORDED\n"
                        "NMI of action and class                 0.250     0.500     0.375\n"));
}

TEST(ReportTextTest, NamesOfActionsStandBesideTheirIds) {
  v1::EvaluationReport report;
  for (const double probability : {0.25, 0.75}) {
    report.add_action_uses()->set_probability(probability);
  }
  const std::vector<std::string> names = {"keep speed", "left turn, tight"};
  EXPECT_EQ(ReportText(report, false, names),
            "WHAT EACH ACTION DOES  MEAN p(y|s)  EXAMPLES\n"
            "1  left turn, tight         75.0 %         0\n"
            "0  keep speed               25.0 %         0\n");
}

TEST(ReportTextTest, ReportsOfOlderReleasesHaveNoRelativeClasses) {
  v1::EvaluationReport report;
  v1::ActionUse& use = *report.add_action_uses();
  use.set_probability(0.75);
  use.set_examples(3);
  use.set_kinematic_class("u_turn");
  use.set_class_share(0.5);
  EXPECT_EQ(ReportText(report, false),
            "WHAT EACH ACTION DOES  MEAN p(y|s)  EXAMPLES  KINEMATIC  PURITY\n"
            "0                           75.0 %         3     u_turn  50.0 %\n");
}

TEST(ReportTextTest, BinsActionsAndStrataHaveTablesOfTheirOwn) {
  v1::EvaluationReport report;
  v1::ReliabilityBin& bin = *report.add_reliability();
  bin.set_lower(0.5);
  bin.set_upper(0.6);
  bin.set_examples(7);
  bin.set_mean_confidence(0.55);
  bin.set_mean_responsibility(0.5);
  report.add_reliability()->set_lower(0.6);  // empty: left out
  report.add_action_uses()->set_probability(0.25);
  v1::ActionUse& use = *report.add_action_uses();
  use.set_probability(0.75);
  use.set_examples(3);
  use.set_kinematic_class("u_turn");
  use.set_class_share(0.5);
  use.set_relative_class("brakes");
  use.set_relative_class_share(2.0 / 3.0);
  v1::EvaluationStratum& stratum = *report.add_strata();
  stratum.set_dimension("turn");
  stratum.set_name("left");
  stratum.set_examples(12);
  (*stratum.mutable_metrics())["ade_1"] = 1.5;
  v1::EvaluationStratum& nobody = *report.add_strata();  // no target of a type: left out
  nobody.set_dimension("type");
  nobody.set_name("cyclist");
  EXPECT_EQ(ReportText(report, false),
            "p(y|s) OF THE LIKELIEST  EXAMPLES  MEAN p(y|s)  MEAN q(y|x,s)\n"
            "0.5 to 0.6                      7        0.550          0.500\n"
            "\n"
            "WHAT EACH ACTION DOES  MEAN p(y|s)  EXAMPLES  RELATIVE  PURITY  KINEMATIC  PURITY\n"
            "1                           75.0 %         3    brakes  66.7 %     u_turn  50.0 %\n"
            "0                           25.0 %         0\n"
            "\n"
            "EXAMPLES BY  EXAMPLES   ADE\n"
            "turn: left         12  1.50\n");
}

TEST(ReportTextTest, ColoursOnlyTitles) {
  v1::EvaluationReport report;
  (*report.mutable_metrics())["nll"] = 1.8;
  EXPECT_THAT(ReportText(report, true),
              HasSubstr("\x1b[1mLIKELIHOOD (-ln p, nats)  MODEL\x1b[0m\n"));
  EXPECT_THAT(ReportText(report, false), Not(HasSubstr("\x1b")));
  EXPECT_EQ(ReportText({}, true), "");
}

}  // namespace
}  // namespace maneuver::evaluation::report_text_test
