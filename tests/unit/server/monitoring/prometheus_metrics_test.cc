#include "server/monitoring/prometheus_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "tests/unit/temporary_folder.h"

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

TEST(PrometheusMetricsTest, RefusesAPortInUse) {
  const auto first = PrometheusMetrics::Create();
  const auto port = first->Listen("127.0.0.1:0");
  ASSERT_TRUE(port.ok()) << port.status();
  EXPECT_GT(*port, 0);
  const auto second = PrometheusMetrics::Create();
  EXPECT_TRUE(absl::IsUnavailable(second->Listen("127.0.0.1:" + std::to_string(*port)).status()));
}

int ConnectTo(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int descriptor = socket(AF_INET, SOCK_STREAM, 0);
  EXPECT_EQ(connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return descriptor;
}

// Returns the page of 127.0.0.1:`port` over HTTP.
std::string Fetch(int port) {
  const int descriptor = ConnectTo(port);
  constexpr std::string_view kRequest = "GET /metrics HTTP/1.0\r\n\r\n";
  EXPECT_EQ(write(descriptor, kRequest.data(), kRequest.size()), ssize_t{kRequest.size()});
  std::string page;
  char bytes[4096];
  for (ssize_t n; (n = read(descriptor, bytes, sizeof bytes)) > 0;) page.append(bytes, n);
  close(descriptor);
  return page;
}

TEST(PrometheusMetricsTest, SilentConnectionsDoNotBlockAScrape) {
  const auto metrics = PrometheusMetrics::Create();
  const auto port = metrics->Listen("127.0.0.1:0");
  ASSERT_TRUE(port.ok()) << port.status();
  std::vector<int> silent;
  for (int i = 0; i < 3; ++i) silent.push_back(ConnectTo(*port));
  const auto start = std::chrono::steady_clock::now();
  EXPECT_THAT(Fetch(*port), HasSubstr("200 OK"));
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(1));
  for (const int descriptor : silent) close(descriptor);
}

// During an upgrade a server is down for as long as it takes to stop. Waiting for civetweb alone
// would take about two seconds.
TEST(PrometheusMetricsTest, StopsServingThePageAtOnce) {
  const auto start = std::chrono::steady_clock::now();
  for (const char* address : {"127.0.0.1:0", "127.0.0.1:0", "0.0.0.0:0", "localhost:0"}) {
    const auto metrics = PrometheusMetrics::Create();
    const auto port = metrics->Listen(address);
    ASSERT_TRUE(port.ok()) << port.status();
    EXPECT_THAT(Fetch(*port), HasSubstr("200 OK"));
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(3));
}

}  // namespace
}  // namespace maneuver::monitoring
