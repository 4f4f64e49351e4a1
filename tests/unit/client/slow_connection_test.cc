// A server that can be reached, but slowly.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>
#include <thread>

#include "client/client.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::slow_connection_test {
namespace {

sockaddr_in Loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(static_cast<uint16_t>(port));
  return address;
}

// Accepts one connection, keeps it waiting, then passes bytes on in both directions.
class SlowDoor {
 public:
  SlowDoor(int server_port, std::chrono::milliseconds delay) {
    listener_ = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address = Loopback(0);
    socklen_t size = sizeof(address);
    EXPECT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(listen(listener_, 1), 0);
    EXPECT_EQ(getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this, server_port, delay] { Pass(server_port, delay); });
  }
  ~SlowDoor() {
    shutdown(listener_, SHUT_RDWR);
    thread_.join();
    close(listener_);
  }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  void Pass(int server_port, std::chrono::milliseconds delay) const {
    const int caller = accept(listener_, nullptr, nullptr);
    if (caller < 0) return;
    std::this_thread::sleep_for(delay);
    const int server = socket(AF_INET, SOCK_STREAM, 0);
    const sockaddr_in address = Loopback(server_port);
    if (connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
      while (PassOne(caller, server)) {
      }
    }
    close(server);
    close(caller);
  }

  // Returns false once either side has closed.
  static bool PassOne(int caller, int server) {
    std::array<pollfd, 2> ends = {pollfd{caller, POLLIN, 0}, pollfd{server, POLLIN, 0}};
    if (poll(ends.data(), ends.size(), /*timeout=*/10'000) <= 0) return false;
    for (size_t i = 0; i < ends.size(); ++i) {
      if (ends[i].revents == 0) continue;
      std::array<char, 4096> bytes;
      const ssize_t read = recv(ends[i].fd, bytes.data(), bytes.size(), 0);
      if (read <= 0) return false;
      if (send(ends[1 - i].fd, bytes.data(), static_cast<size_t>(read), MSG_NOSIGNAL) != read) {
        return false;
      }
    }
    return true;
  }

  int listener_ = -1;
  int port_ = 0;
  std::jthread thread_;
};

int PortOf(const std::string& address) { return std::stoi(address.substr(address.rfind(':') + 1)); }

// gRPC gives a connection attempt GRPC_ARG_MIN_RECONNECT_BACKOFF_MS. A value for quick retries
// would shut out every server that is further away, or just busy.
TEST(SlowConnectionTest, ReachesAServerThatIsSlowToAccept) {
  TestServer server;
  server.on_predict = [](auto*, const auto&, v1::PredictResponse* response) {
    response->set_model_version("models/town/versions/1");
    return grpc::Status::OK;
  };
  SlowDoor door(PortOf(server.address()), std::chrono::milliseconds(600));
  {
    ClientOptions options;
    options.address = door.address();
    options.retry.max_attempts = 1;
    const auto answer = (*Client::Connect(options))->Predict({});
    ASSERT_TRUE(answer.ok()) << answer.status();
    EXPECT_EQ(answer->model_version(), "models/town/versions/1");
  }
}

}  // namespace
}  // namespace maneuver::client::slow_connection_test
