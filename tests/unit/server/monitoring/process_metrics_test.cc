#include "server/monitoring/process_metrics.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <chrono>
#include <vector>

#include "server/monitoring/prometheus_metrics.h"

namespace maneuver::monitoring::process_metrics_test {
namespace {

using ::testing::HasSubstr;

TEST(ProcessMetricsTest, CountsTouchedMemoryAsResident) {
  const auto before = ReadProcessMetrics();
  constexpr size_t kBytes = 64 << 20;
  std::vector<char> memory(kBytes, 'x');
  const auto after = ReadProcessMetrics();
  ASSERT_TRUE(before && after);
  EXPECT_EQ(memory[kBytes / 2], 'x');
  EXPECT_NEAR(after->resident_bytes - before->resident_bytes, kBytes, 0.1 * kBytes);
  EXPECT_NEAR(after->virtual_bytes - before->virtual_bytes, kBytes, 0.1 * kBytes);
  EXPECT_GE(after->virtual_bytes, after->resident_bytes);
}

TEST(ProcessMetricsTest, CountsEachOpenDescriptor) {
  const auto before = ReadProcessMetrics();
  const int first = open("/dev/null", O_RDONLY);
  const int second = dup(first);
  const auto after = ReadProcessMetrics();
  close(first);
  close(second);
  ASSERT_TRUE(before && after);
  EXPECT_EQ(after->open_descriptors - before->open_descriptors, 2.0);
  EXPECT_EQ(ReadProcessMetrics()->open_descriptors, before->open_descriptors);
  EXPECT_EQ(before->max_descriptors, static_cast<double>(sysconf(_SC_OPEN_MAX)));
}

// getrusage counts the same time at a finer resolution.
TEST(ProcessMetricsTest, ProcessorTimeIncludesUserAndSystemTime) {
  const auto spent = [] {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& time) {
      return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
  };
  while (spent() < 0.1) {
  }
  EXPECT_NEAR(ReadProcessMetrics()->cpu_seconds, spent(), 0.05);
}

TEST(ProcessMetricsTest, TheStartTimeIsRecent) {
  const double now =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  const double start = ReadProcessMetrics()->start_time_seconds;
  EXPECT_LT(start, now + 2.0);  // the kernel rounds to seconds
  EXPECT_GT(start, now - 600.0);
}

TEST(ProcessMetricsTest, ThePageShowsThem) {
  const std::string page = PrometheusMetrics::Create()->Page();
  EXPECT_THAT(page, HasSubstr("# TYPE process_cpu_seconds_total counter\n"));
  EXPECT_THAT(page, HasSubstr("# TYPE process_resident_memory_bytes gauge\n"));
  EXPECT_THAT(page, HasSubstr("\nprocess_open_fds "));
}

}  // namespace
}  // namespace maneuver::monitoring::process_metrics_test
