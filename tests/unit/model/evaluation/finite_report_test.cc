#include "model/evaluation/finite_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace maneuver::evaluation::finite_report_test {
namespace {

using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

v1::EvaluationReport Finite() {
  v1::EvaluationReport report;
  (*report.mutable_metrics())["ade_1"] = 1.0;
  report.add_action_usage(0.5);
  report.add_action_usage(0.5);
  v1::EvaluationStratum& stratum = *report.add_strata();
  stratum.set_name("slow");
  (*stratum.mutable_metrics())["fde_1"] = 2.0;
  return report;
}

std::string Message(const v1::EvaluationReport& report) {
  const absl::Status status = CheckFinite(report);
  EXPECT_EQ(status.code(), absl::StatusCode::kOutOfRange);
  return std::string(status.message());
}

TEST(FiniteReportTest, AReportOfFiniteNumbersPasses) { EXPECT_TRUE(CheckFinite(Finite()).ok()); }

TEST(FiniteReportTest, NamesANonFiniteMetric) {
  v1::EvaluationReport report = Finite();
  (*report.mutable_metrics())["min_ade_6"] = std::numeric_limits<double>::infinity();
  EXPECT_THAT(Message(report), HasSubstr("metrics[\"min_ade_6\"]"));
}

TEST(FiniteReportTest, NamesANonFiniteMetricOfAStratum) {
  v1::EvaluationReport report = Finite();
  (*report.mutable_strata(0)->mutable_metrics())["fde_1"] = kNan;
  EXPECT_THAT(Message(report), HasSubstr("strata[0].metrics[\"fde_1\"]"));
}

TEST(FiniteReportTest, NamesANonFiniteElementOfAList) {
  v1::EvaluationReport report = Finite();
  report.set_action_usage(1, kNan);
  EXPECT_THAT(Message(report), HasSubstr("action_usage[1]"));
}

TEST(FiniteReportTest, NamesANonFiniteRange) {
  v1::EvaluationReport report = Finite();
  (*report.mutable_input_ranges())["speed"].set_low(kNan);
  EXPECT_THAT(Message(report), HasSubstr("input_ranges[\"speed\"].low"));
}

}  // namespace
}  // namespace maneuver::evaluation::finite_report_test
