#include "server/monitoring/http_pages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <vector>

#include "server/monitoring/prometheus_metrics.h"

namespace maneuver::monitoring::http_pages_test {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

int ConnectTo(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int descriptor = socket(AF_INET, SOCK_STREAM, 0);
  EXPECT_EQ(connect(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return descriptor;
}

// What 127.0.0.1:`port` answers to "GET /page".
std::string Ask(int port, const std::string& line) {
  const int descriptor = ConnectTo(port);
  const std::string request = line + " HTTP/1.0\r\n\r\n";
  EXPECT_EQ(write(descriptor, request.data(), request.size()), ssize_t(request.size()));
  std::string answer;
  char bytes[4096];
  for (ssize_t n; (n = read(descriptor, bytes, sizeof bytes)) > 0;) answer.append(bytes, n);
  close(descriptor);
  return answer;
}

// One page, /echo, whose answer is the query.
std::unique_ptr<HttpPages> Serve(const std::string& address = "127.0.0.1:0") {
  auto pages = HttpPages::Serve(
      address, {{.path = "/echo", .make = [](std::string_view query) {
                   return HttpAnswer{query.empty() ? 503 : 200, std::string(query)};
                 }}});
  EXPECT_TRUE(pages.ok()) << pages.status();
  return *std::move(pages);
}

TEST(HttpPagesTest, AnswersWithStatusTypeAndText) {
  const auto pages = Serve();
  const std::string found = Ask(pages->port(), "GET /echo?a=b");
  EXPECT_THAT(found, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(found, HasSubstr("Content-Type: text/plain; charset=utf-8\r\n"));
  EXPECT_THAT(found, HasSubstr("Content-Length: 3\r\n"));
  EXPECT_THAT(found, EndsWith("\r\n\r\na=b"));
  EXPECT_THAT(Ask(pages->port(), "GET /echo"), StartsWith("HTTP/1.1 503 Service Unavailable\r\n"));
  EXPECT_THAT(Ask(pages->port(), "HEAD /echo?a=b"), EndsWith("\r\n\r\n"));
}

TEST(HttpPagesTest, RefusesOtherPathsAndMethods) {
  const auto pages = Serve();
  for (const char* path : {"/", "/ech", "/echo/", "/echo/x", "/etc/passwd", "/../etc/passwd"}) {
    EXPECT_THAT(Ask(pages->port(), std::string("GET ") + path), HasSubstr(" 404 ")) << path;
  }
  EXPECT_THAT(Ask(pages->port(), "POST /echo?a=b"), HasSubstr(" 405 "));
  EXPECT_THAT(Ask(pages->port(), "DELETE /echo?a=b"), HasSubstr(" 405 "));
}

TEST(HttpPagesTest, ShowsMetrics) {
  const auto metrics = PrometheusMetrics::Create();
  metrics->AddGauge("maneuver_depth", "Depth.").Set(3);
  const auto pages = HttpPages::Serve("127.0.0.1:0", {MetricsPage(*metrics)});
  ASSERT_TRUE(pages.ok()) << pages.status();
  const std::string page = Ask((*pages)->port(), "GET /metrics");
  EXPECT_THAT(page, HasSubstr("200 OK"));
  EXPECT_THAT(page, HasSubstr("Content-Type: text/plain; version=0.0.4; charset=utf-8\r\n"));
  EXPECT_THAT(page, HasSubstr("\nmaneuver_depth 3\n"));
}

TEST(HttpPagesTest, ATakenPortIsAnError) {
  const auto first = Serve();
  EXPECT_GT(first->port(), 0);
  EXPECT_TRUE(absl::IsUnavailable(
      HttpPages::Serve("127.0.0.1:" + std::to_string(first->port()), {}).status()));
}

TEST(HttpPagesTest, SaysThatIpv6IsNotServed) {
  const auto pages = HttpPages::Serve("[::1]:0", {});
  if (pages.ok()) GTEST_SKIP() << "this civetweb knows IPv6";
  EXPECT_THAT(std::string(pages.status().message()), HasSubstr("they have IPv4 addresses only"));
}

TEST(HttpPagesTest, SilentConnectionsDoNotDelayAScrape) {
  const auto pages = Serve();
  const auto time = [&pages] {
    const auto start = std::chrono::steady_clock::now();
    EXPECT_THAT(Ask(pages->port(), "GET /echo?a"), HasSubstr("200 OK"));
    return std::chrono::steady_clock::now() - start;
  };
  const auto alone = time();
  std::vector<int> silent;
  for (int i = 0; i < 200; ++i) silent.push_back(ConnectTo(pages->port()));
  // With 50 threads, as civetweb has by itself, it would take 2 s.
  EXPECT_LT(time(), std::chrono::milliseconds(1500) + 10 * alone);
  for (const int descriptor : silent) close(descriptor);
}

// A server that is upgraded is away for as long as its end takes. Whoever waits for civetweb waits
// some two seconds for each.
TEST(HttpPagesTest, EndsAtOnce) {
  const auto start = std::chrono::steady_clock::now();
  for (const char* address : {"127.0.0.1:0", "127.0.0.1:0", "0.0.0.0:0", "localhost:0"}) {
    const auto pages = Serve(address);
    EXPECT_THAT(Ask(pages->port(), "GET /echo?a"), HasSubstr("200 OK"));
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(6));
}

}  // namespace
}  // namespace maneuver::monitoring::http_pages_test
