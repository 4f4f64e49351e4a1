#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "client/cli/comparison_text.h"
#include "client/cli/job_display.h"

namespace maneuver::cli::comparison_test {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

v1::MetricComparison* Add(const std::string& name, const std::string& unit, double baseline,
                          double candidate, v1::MetricVerdict verdict,
                          google::protobuf::RepeatedPtrField<v1::MetricComparison>* metrics) {
  v1::MetricComparison* metric = metrics->Add();
  metric->set_metric(name);
  metric->set_unit(unit);
  metric->set_baseline_value(baseline);
  metric->set_candidate_value(candidate);
  metric->set_verdict(verdict);
  return metric;
}

v1::EvaluationComparison Comparison() {
  v1::EvaluationComparison comparison;
  comparison.set_baseline("models/town/versions/1");
  comparison.set_candidate("models/town/versions/2");
  auto* metrics = comparison.mutable_metrics();
  Add("min_ade_6", "m", 1.0, 0.75, v1::METRIC_VERDICT_BETTER, metrics);
  Add("miss_rate_6", "share", 0.125, 0.25, v1::METRIC_VERDICT_WORSE, metrics);
  Add("nll", "nats", 1.5, 1.5, v1::METRIC_VERDICT_NO_WORSE, metrics);
  Add("fde_1", "m", 1.5, 1.625, v1::METRIC_VERDICT_NO_WORSE, metrics)->set_tolerance(0.5);
  Add("effective_actions", "", 12.0, 9.0, v1::METRIC_VERDICT_UNSPECIFIED, metrics);
  Add("ade_1", "m", 1.0, std::nan(""), v1::METRIC_VERDICT_WORSE, metrics);
  Add("ade_cv", "m", 3.0, 3.0, v1::METRIC_VERDICT_UNSPECIFIED, metrics);
  return comparison;
}

TEST(ComparisonTextTest, ShowsBothValuesTheDifferenceAndTheBetterVersion) {
  EXPECT_EQ(ComparisonText(Comparison(), false),
            "METRIC             UNIT  town/1  town/2  DIFFERENCE  BETTER\n"
            "min_ade_6          m      1.000   0.750      -0.250  town/2\n"
            "miss_rate_6        %      12.50   25.00      +12.50  town/1\n"
            "nll                nats   1.500   1.500       0.000  =\n"
            "fde_1              m      1.500   1.625      +0.125  within\n"
            "effective_actions        12.000   9.000      -3.000\n"
            "ade_1              m      1.000       -           -  town/1\n");
}

TEST(ComparisonTextTest, ShowsTheMainMetricsOfEachStratum) {
  v1::EvaluationComparison comparison = Comparison();
  EXPECT_THAT(StrataText(comparison, false), IsEmpty());
  v1::StratumComparison* stratum = comparison.add_strata();
  stratum->set_dimension("turn");
  stratum->set_name("left");
  stratum->set_examples(30);
  Add("nll", "nats", 1.0, 2.0, v1::METRIC_VERDICT_WORSE, stratum->mutable_metrics());
  Add("fde_1", "m", 1.0, 2.0, v1::METRIC_VERDICT_WORSE, stratum->mutable_metrics());
  EXPECT_EQ(StrataText(comparison, false),
            "EXAMPLES BY  EXAMPLES  METRIC  UNIT  town/1  town/2  DIFFERENCE  BETTER\n"
            "turn: left         30  nll     nats   1.000   2.000      +1.000  town/1\n");
}

TEST(PromotionTextTest, SaysWhetherAndWhyAVersionWasPromoted) {
  v1::Job job;
  job.set_model_version("models/town/versions/2");
  EXPECT_THAT(PromotionText(job, false), IsEmpty());
  job.mutable_promotion_decision()->set_reason("the request said never");
  EXPECT_EQ(PromotionText(job, false), "town/2 was not promoted: the request said never\n");
  job.mutable_promotion_decision()->set_promoted(true);
  *job.mutable_promotion_decision()->mutable_comparison() = Comparison();
  EXPECT_THAT(PromotionText(job, false), HasSubstr("town/2 was promoted: "));
  EXPECT_THAT(PromotionText(job, false), HasSubstr("\nmin_ade_6          m "));
}

}  // namespace
}  // namespace maneuver::cli::comparison_test
