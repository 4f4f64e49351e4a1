#include "model/evaluation/report_comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace maneuver::evaluation::report_comparison_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

v1::EvaluationReport Report(int version) {
  v1::EvaluationReport report;
  report.set_model_version("models/town/versions/" + std::to_string(version));
  report.set_dataset("datasets/unseen");
  report.set_dataset_sha256("abc");
  report.set_examples(100);
  report.mutable_create_time()->set_seconds(1'000 * version);
  report.mutable_example_settings()->mutable_stride()->set_seconds(1);
  report.mutable_example_settings()->set_keep_standing(0.5);
  report.mutable_trajectory()->set_waypoints(10);
  report.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(400'000'000);
  return report;
}

TEST(ReportComparisonTest, RefusesReportsOfOtherExamples) {
  struct Case {
    std::function<void(v1::EvaluationReport&)> change;
    std::string says;
  };
  const std::vector<Case> cases = {
      {[](auto& r) { r.set_dataset("datasets/other"); }, "on datasets/other"},
      {[](auto& r) { r.set_dataset_sha256("abd"); }, "evaluate models/town/versions/1"},
      {[](auto& r) { r.mutable_example_settings()->mutable_stride()->set_seconds(2); },
       "stride=2s"},
      {[](auto& r) { r.mutable_example_settings()->set_keep_standing(1.0); }, "keep_standing=1"},
      {[](auto& r) { r.mutable_example_settings()->set_standing_distance(2.0); },
       "standing_distance=2"},
      {[](auto& r) { r.mutable_example_settings()->set_max_speed(9.0); }, "max_speed=9"},
      {[](auto& r) { r.mutable_trajectory()->set_waypoints(12); }, "12 waypoints of 0.4 s"},
      {[](auto& r) { r.set_examples(99); }, "the other over 99"},
      {[](auto& r) { r.add_target_types(v1::AGENT_TYPE_CYCLIST); }, "VEHICLE, the other CYCLIST"},
  };
  EXPECT_TRUE(CheckComparable(Report(1), Report(2)).ok());
  for (const Case& each : cases) {
    v1::EvaluationReport other = Report(2);
    each.change(other);
    const absl::Status status = CheckComparable(Report(1), other);
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << each.says;
    EXPECT_THAT(std::string(status.message()), HasSubstr(each.says));
    EXPECT_FALSE(CompareReports(Report(1), other).ok()) << each.says;
  }
}

TEST(ReportComparisonTest, NoTargetTypesMeanVehicles) {
  v1::EvaluationReport stated = Report(2);
  stated.add_target_types(v1::AGENT_TYPE_VEHICLE);
  EXPECT_TRUE(CheckComparable(Report(1), stated).ok());
}

TEST(ReportComparisonTest, TrainingSettingsDoNotMatter) {
  v1::EvaluationReport other = Report(2);
  other.mutable_example_settings()->set_validation_share(0.5);
  other.mutable_example_settings()->set_max_examples(7);
  other.mutable_example_settings()->set_label_share(0.1);
  EXPECT_TRUE(CheckComparable(Report(1), other).ok());
}

TEST(ReportComparisonTest, ListsBothValuesInTheOrderOfTheMetricTable) {
  v1::EvaluationReport baseline = Report(1);
  v1::EvaluationReport candidate = Report(2);
  for (auto* report : {&baseline, &candidate}) {
    auto& metrics = *report->mutable_metrics();
    const bool is_first = report == &baseline;
    metrics["nll"] = is_first ? 1.5 : 1.25;
    metrics["min_ade_10"] = is_first ? 0.5 : 0.75;
    metrics["min_ade_6"] = 1.0;
    metrics["ade_cv"] = 4.0;
    metrics["nll_prior"] = 2.0;
    metrics["unheard_of"] = is_first ? 1.0 : 2.0;
    metrics[is_first ? "purity" : "nmi"] = 0.5;
    v1::EvaluationStratum& stratum = *report->add_strata();
    stratum.set_dimension("turn");
    stratum.set_name("left");
    stratum.set_examples(30);
    (*stratum.mutable_metrics())["nll"] = is_first ? 1.0 : 3.0;
  }
  const auto comparison = CompareReports(baseline, candidate);
  ASSERT_TRUE(comparison.ok()) << comparison.status();
  EXPECT_EQ(comparison->baseline(), "models/town/versions/1");
  EXPECT_EQ(comparison->candidate(), "models/town/versions/2");
  EXPECT_EQ(comparison->examples(), 100);
  std::vector<std::string> names;
  for (const auto& metric : comparison->metrics()) names.push_back(metric.metric());
  EXPECT_THAT(names,
              ElementsAre("min_ade_6", "min_ade_10", "nll", "nll_prior", "ade_cv", "unheard_of"));
  EXPECT_EQ(comparison->metrics(0).verdict(), v1::METRIC_VERDICT_NO_WORSE);
  EXPECT_EQ(comparison->metrics(1).verdict(), v1::METRIC_VERDICT_WORSE);
  EXPECT_EQ(comparison->metrics(1).baseline_value(), 0.5);
  EXPECT_EQ(comparison->metrics(1).candidate_value(), 0.75);
  EXPECT_EQ(comparison->metrics(1).unit(), "m");
  EXPECT_EQ(comparison->metrics(2).verdict(), v1::METRIC_VERDICT_BETTER);
  EXPECT_EQ(comparison->metrics(5).verdict(), v1::METRIC_VERDICT_UNSPECIFIED);
  ASSERT_EQ(comparison->strata_size(), 1);
  EXPECT_EQ(comparison->strata(0).examples(), 30);
  EXPECT_EQ(comparison->strata(0).metrics(0).verdict(), v1::METRIC_VERDICT_WORSE);
}

TEST(ReportComparisonTest, RefusesAMetricThatOneReportLacks) {
  v1::EvaluationReport baseline = Report(1);
  (*baseline.mutable_metrics())["nmi"] = 0.5;
  const auto comparison = CompareMetric(baseline, Report(2), "nmi", 0.0);
  EXPECT_TRUE(absl::IsFailedPrecondition(comparison.status()));
  EXPECT_THAT(std::string(comparison.status().message()),
              HasSubstr("models/town/versions/2 has no nmi"));
  EXPECT_TRUE(absl::IsFailedPrecondition(CompareMetric(baseline, baseline, "x", 0.0).status()));
}

}  // namespace
}  // namespace maneuver::evaluation::report_comparison_test
