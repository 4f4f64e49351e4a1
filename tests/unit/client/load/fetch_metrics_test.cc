#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/load/metrics_page.h"

namespace maneuver::load::fetch_metrics_test {
namespace {

using testing::HasSubstr;

// Answers on a free port of 127.0.0.1.
class FetchMetricsTest : public testing::Test {
 protected:
  FetchMetricsTest() : port_(server_.bind_to_any_port("127.0.0.1")) {
    server_.Get("/metrics", [](const httplib::Request&, httplib::Response& response) {
      response.set_content("answers_total 3\n", "text/plain");
    });
    server_.Get("/large", [](const httplib::Request&, httplib::Response& response) {
      response.set_content(std::string(size_t{17} << 20, '\n'), "text/plain");
    });
    thread_ = std::thread([this] { server_.listen_after_bind(); });
    while (!server_.is_running()) std::this_thread::yield();
  }
  ~FetchMetricsTest() override {
    server_.stop();
    thread_.join();
  }

  std::string Url(const std::string& path) const {
    return absl::StrCat("http://127.0.0.1:", port_, path);
  }

 private:
  httplib::Server server_;
  const int port_;
  std::thread thread_;
};

TEST_F(FetchMetricsTest, ReadsAPage) {
  for (const std::string& url : {Url("/metrics"), Url("").substr(strlen("http://"))}) {
    const auto page = FetchMetrics(url);
    ASSERT_TRUE(page.ok()) << page.status();
    EXPECT_EQ(page->Sum("answers_total"), 3.0) << url;
  }
}

TEST_F(FetchMetricsTest, RefusesAPageThatIsNotThere) {
  const absl::Status status = FetchMetrics(Url("/other")).status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(status.message(), HasSubstr("not 200 OK"));
}

TEST_F(FetchMetricsTest, RefusesAPageThatIsTooLarge) {
  const absl::Status status = FetchMetrics(Url("/large"), std::chrono::seconds(60)).status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(status.message(), HasSubstr("too large"));
}

// Accepts connections and never sends anything.
class SilentServer {
 public:
  SilentServer() : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    auto* const any = reinterpret_cast<sockaddr*>(&address);
    EXPECT_EQ(bind(socket_, any, size), 0);
    EXPECT_EQ(listen(socket_, 1), 0);
    EXPECT_EQ(getsockname(socket_, any, &size), 0);
    port_ = ntohs(address.sin_port);
  }
  ~SilentServer() { close(socket_); }
  SilentServer(const SilentServer&) = delete;
  SilentServer& operator=(const SilentServer&) = delete;

  int port() const { return port_; }

 private:
  const int socket_;
  int port_ = 0;
};

TEST(FetchMetricsPatienceTest, GivesUpOnAServerThatSaysNothing) {
  const SilentServer server;
  const absl::Status status =
      FetchMetrics(absl::StrCat("127.0.0.1:", server.port()), std::chrono::milliseconds(20))
          .status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(status.message(), HasSubstr("in time"));
}

TEST(FetchMetricsAddressTest, DistinguishesInvalidAddressesFromUnreachableOnes) {
  for (const char* url : {"", "https://localhost:1/metrics", "localhost", "http://", "http://:80/",
                          "localhost:http", "localhost:70000", "localhost:"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(FetchMetrics(url).status())) << url;
    EXPECT_TRUE(absl::IsInvalidArgument(CheckMetricsAddress(url))) << url;
  }
  EXPECT_TRUE(CheckMetricsAddress("127.0.0.1:9470").ok());
  // Nobody listens on port 1 of this machine.
  EXPECT_TRUE(absl::IsUnavailable(FetchMetrics("http://127.0.0.1:1/metrics").status()));
  EXPECT_TRUE(absl::IsUnavailable(FetchMetrics("[::1]:1").status()));
}

}  // namespace
}  // namespace maneuver::load::fetch_metrics_test
