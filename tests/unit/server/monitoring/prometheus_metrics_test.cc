#include "server/monitoring/prometheus_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/statvfs.h>

#include <filesystem>
#include <string>

#include "tests/unit/temporary_folder.h"

namespace maneuver::monitoring::prometheus_metrics_test {
namespace {

using ::testing::HasSubstr;

TEST(PrometheusMetricsTest, ThePageShowsTheCounts) {
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

TEST(PrometheusMetricsTest, ReadsTheDiskOfAFolderForEachPage) {
  const auto metrics = PrometheusMetrics::Create();
  const TemporaryFolder parent;
  const std::filesystem::path folder = parent / "watched";
  std::filesystem::create_directory(folder);
  metrics->WatchDisk(folder);
  struct statvfs disk {};
  ASSERT_EQ(statvfs(folder.c_str(), &disk), 0);
  const auto value = [&metrics](const std::string& name) {
    const std::string page = metrics->Page();
    const size_t at = page.find("\n" + name + " ");
    return at == std::string::npos ? -1.0 : std::stod(page.substr(at + name.size() + 2));
  };
  const double block = static_cast<double>(disk.f_frsize);
  const double size = block * static_cast<double>(disk.f_blocks);
  EXPECT_EQ(value("maneuver_data_disk_bytes"), size);
  // Others write to the disk meanwhile.
  EXPECT_NEAR(value("maneuver_data_disk_free_bytes"), block * static_cast<double>(disk.f_bavail),
              0.05 * size);
  std::filesystem::remove(folder);
  EXPECT_EQ(value("maneuver_data_disk_free_bytes"), -1.0);
}

}  // namespace
}  // namespace maneuver::monitoring::prometheus_metrics_test
