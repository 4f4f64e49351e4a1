#include "server/monitoring/prometheus_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maneuver::monitoring {
namespace {

using ::testing::HasSubstr;

TEST(PrometheusMetricsTest, ThePageShowsWhatWasCounted) {
  const auto metrics = PrometheusMetrics::Create();
  metrics->AddCounter("maneuver_calls_total", "Calls.", {{"code", "OK"}}).Increment();
  metrics->AddGauge("maneuver_depth", "Depth.").Set(3);
  Histogram& histogram = metrics->AddHistogram("maneuver_seconds", "Time.", {0.1, 1.0});
  histogram.Observe(0.05);
  histogram.Observe(0.5);
  const std::string page = metrics->Page();
  EXPECT_THAT(page, HasSubstr("# HELP maneuver_calls_total Calls.\n"
                              "# TYPE maneuver_calls_total counter\n"
                              "maneuver_calls_total{code=\"OK\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_depth 3"));
  EXPECT_THAT(page, HasSubstr("maneuver_seconds_bucket{le=\"0.1\"} 1"));
  EXPECT_THAT(page, HasSubstr("maneuver_seconds_bucket{le=\"1\"} 2"));
  EXPECT_THAT(page, HasSubstr("maneuver_seconds_bucket{le=\"+Inf\"} 2"));
}

TEST(PrometheusMetricsTest, TheSameNameAndLabelsAreTheSameMetric) {
  const auto metrics = PrometheusMetrics::Create();
  EXPECT_EQ(&metrics->AddCounter("a_total", "A.", {{"x", "1"}}),
            &metrics->AddCounter("a_total", "A.", {{"x", "1"}}));
  EXPECT_NE(&metrics->AddCounter("a_total", "A.", {{"x", "1"}}),
            &metrics->AddCounter("a_total", "A.", {{"x", "2"}}));
}

TEST(PrometheusMetricsTest, ATakenPortIsAnError) {
  const auto first = PrometheusMetrics::Create();
  const auto port = first->Listen("127.0.0.1:0");
  ASSERT_TRUE(port.ok()) << port.status();
  EXPECT_GT(*port, 0);
  const auto second = PrometheusMetrics::Create();
  EXPECT_TRUE(absl::IsUnavailable(second->Listen("127.0.0.1:" + std::to_string(*port)).status()));
}

}  // namespace
}  // namespace maneuver::monitoring
