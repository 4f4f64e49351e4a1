#include "model/evaluation/example_metrics.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

#include "model/evaluation/metric_table.h"
#include "model/evaluation/report.h"

namespace maneuver::evaluation::example_metrics_test {
namespace {

TEST(ExampleMetricsTest, EveryNameIsUniqueAndInTheMetricTable) {
  std::set<std::string> names;
  for (const ExampleMetric& metric : ExampleMetrics(true, true)) {
    EXPECT_TRUE(names.insert(metric.name).second) << metric.name;
    EXPECT_TRUE(FindMetric(metric.name).has_value()) << metric.name;
  }
  for (const MetricRatio& ratio : MetricRatios()) {
    EXPECT_TRUE(FindMetric(ratio.name).has_value()) << ratio.name;
    EXPECT_TRUE(names.contains(std::string(ratio.numerator))) << ratio.name;
    EXPECT_TRUE(names.contains(std::string(ratio.denominator))) << ratio.name;
  }
}

TEST(ExampleMetricsTest, HasNoMetricForWhatWasNotMeasured) {
  for (const ExampleMetric& metric : ExampleMetrics(false, false)) {
    EXPECT_EQ(metric.name.find("waymo"), std::string::npos) << metric.name;
    EXPECT_EQ(metric.name.find("covernet"), std::string::npos) << metric.name;
    EXPECT_EQ(metric.name.find("multipath"), std::string::npos) << metric.name;
  }
}

}  // namespace
}  // namespace maneuver::evaluation::example_metrics_test
