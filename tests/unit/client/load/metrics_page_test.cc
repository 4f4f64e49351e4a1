#include "client/load/metrics_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace maneuver::load::metrics_page_test {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

constexpr char kBefore[] = R"(# HELP wait_seconds Time.
# TYPE wait_seconds histogram
wait_seconds_count{stage="queue"} 10
wait_seconds_sum{stage="queue"} 1.5
wait_seconds_bucket{stage="queue",le="0.1"} 6
wait_seconds_bucket{stage="queue",le="0.5"} 10
wait_seconds_bucket{stage="queue",le="+Inf"} 10
calls_total{method="A/B",code="OK"} 100
calls_total{method="A/C",code="OK"} 7
calls_total{method="A/B",code="NOT_FOUND"} 1e3 1395066363000
odd{text="a \"quoted\" \\ , } word"} 4
plain 2.5
)";

TEST(MetricsPageTest, SumsSamplesWithTheGivenLabels) {
  const MetricsPage page = MetricsPage::Parse(kBefore);
  EXPECT_EQ(page.Sum("calls_total"), 1107.0);
  EXPECT_EQ(page.Sum("calls_total", {{"method", "A/B"}}), 1100.0);
  EXPECT_EQ(page.Sum("calls_total", {{"method", "A/B"}, {"code", "OK"}}), 100.0);
  EXPECT_EQ(page.Sum("calls_total", {{"method", "A/D"}}), std::nullopt);
  EXPECT_EQ(page.Sum("plain"), 2.5);
  EXPECT_EQ(page.Sum("calls"), std::nullopt);
  EXPECT_EQ(page.Sum("odd", {{"text", "a \"quoted\" \\ , } word"}}), 4.0);
}

TEST(MetricsPageTest, IgnoresLinesThatAreNotMetrics) {
  const MetricsPage page =
      MetricsPage::Parse("<html>\nbroken{a=\"b} 3\nname\nname{a=\"b\"}\nname x\n\r\ngood 1\r\n");
  EXPECT_EQ(page.Sum("good"), 1.0);
  EXPECT_EQ(page.Sum("name"), std::nullopt);
  EXPECT_EQ(page.Sum("broken"), std::nullopt);
}

TEST(MetricsPageTest, AHistogramsChangeIsWhatItObservedBetweenTwoPages) {
  const MetricsPage before = MetricsPage::Parse(kBefore);
  // Between: 2 up to 0.1 s, 6 up to 0.5 s, 2 beyond.
  const MetricsPage after = MetricsPage::Parse(R"(wait_seconds_count{stage="queue"} 20
wait_seconds_sum{stage="queue"} 5.5
wait_seconds_bucket{stage="queue",le="0.1"} 8
wait_seconds_bucket{stage="queue",le="0.5"} 18
wait_seconds_bucket{stage="queue",le="+Inf"} 20
wait_seconds_count{stage="other"} 1000
)");
  const HistogramChange change = Change(before, after, "wait_seconds", {{"stage", "queue"}});
  EXPECT_THAT(change.buckets, ElementsAre(Pair(0.1, 2), Pair(0.5, 8), Pair(kInfinity, 10)));
  EXPECT_DOUBLE_EQ(change.Mean(), 0.4);
  EXPECT_DOUBLE_EQ(change.Quantile(0.1), 0.05);  // the first of two that share [0, 0.1]
  EXPECT_DOUBLE_EQ(change.Quantile(0.5), 0.1 + 0.4 * 3.0 / 6.0);
  EXPECT_DOUBLE_EQ(change.Quantile(0.99), 0.5);  // how far beyond is unknown
}

TEST(MetricsPageTest, AnEmptyChangeHasNoMean) {
  const MetricsPage page = MetricsPage::Parse(kBefore);
  EXPECT_TRUE(std::isnan(Change(page, page, "wait_seconds").Mean()));
  EXPECT_TRUE(std::isnan(Change(page, page, "wait_seconds").Quantile(0.5)));
  EXPECT_TRUE(std::isnan(Change(page, page, "unknown").Mean()));
}

}  // namespace
}  // namespace maneuver::load::metrics_page_test
