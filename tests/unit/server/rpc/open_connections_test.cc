#include "server/rpc/open_connections.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <string>

namespace maneuver::rpc::open_connections_test {
namespace {

using std::chrono::seconds;

sockaddr* AsAddress(sockaddr_in& address) { return reinterpret_cast<sockaddr*>(&address); }

// A port of loopback that accepts connections and reads nothing.
class OpenConnectionsTest : public testing::Test {
 protected:
  // Both ends of a connection.
  struct Connection {
    int caller = -1;
    int accepted = -1;

    ~Connection() {
      close(caller);
      close(accepted);
    }
    void Send(size_t bytes) const {
      const std::string message(bytes, 'x');
      ASSERT_EQ(send(caller, message.data(), bytes, MSG_NOSIGNAL), static_cast<ssize_t>(bytes));
      // Until it is there.
      std::string received(bytes, ' ');
      ASSERT_EQ(recv(accepted, received.data(), bytes, MSG_WAITALL), static_cast<ssize_t>(bytes));
    }
    bool IsCutOff() const {
      pollfd ended{.fd = caller, .events = POLLRDHUP, .revents = 0};
      return poll(&ended, 1, 0) == 1;
    }
  };

  OpenConnectionsTest() {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(bind(listener_, AsAddress(address), sizeof address), 0);
    EXPECT_EQ(listen(listener_, 8), 0);
    socklen_t size = sizeof address_;
    getsockname(listener_, AsAddress(address_), &size);
  }
  ~OpenConnectionsTest() override { close(listener_); }

  void Connect(Connection& connection) {
    connection.caller = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ASSERT_EQ(connect(connection.caller, AsAddress(address_), sizeof address_), 0);
    connection.accepted = accept(listener_, nullptr, nullptr);
    ASSERT_GE(connection.accepted, 0);
  }

  const int listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address_{};
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

TEST_F(OpenConnectionsTest, CutsOffTheConnectionsThatReceivedTheMost) {
  Connection large, largest, small;
  for (Connection* each : {&large, &largest, &small}) Connect(*each);
  large.Send(20'000);
  largest.Send(30'000);
  small.Send(100);
  ReceivedBytes received(ntohs(address_.sin_port));
  received.Note(begin_);
  EXPECT_EQ(received.CutOffLargest(60'000), 0);
  EXPECT_FALSE(largest.IsCutOff());
  EXPECT_EQ(received.CutOffLargest(25'000), 1);
  EXPECT_TRUE(largest.IsCutOff());
  EXPECT_FALSE(large.IsCutOff());
  EXPECT_EQ(received.CutOffLargest(25'000), 0) << "it is cut off already";
  EXPECT_EQ(received.CutOffLargest(1000), 1);
  EXPECT_TRUE(large.IsCutOff());
  EXPECT_FALSE(small.IsCutOff());
}

TEST_F(OpenConnectionsTest, CutsOffTheConnectionsOfGivenPeers) {
  Connection first, second;
  for (Connection* each : {&first, &second}) Connect(*each);
  const int port = ntohs(address_.sin_port);
  sockaddr_in caller{};
  socklen_t size = sizeof caller;
  ASSERT_EQ(getsockname(second.caller, AsAddress(caller), &size), 0);
  const std::string peer = "ipv4:127.0.0.1:" + std::to_string(ntohs(caller.sin_port));
  EXPECT_EQ(CutOffConnections(port, {}), 0);
  EXPECT_EQ(CutOffConnections(port, {peer, "ipv4:127.0.0.2:1"}), 1);
  EXPECT_TRUE(second.IsCutOff());
  EXPECT_FALSE(first.IsCutOff());
  EXPECT_EQ(CutOffConnections(port, {peer}), 0) << "it is cut off already";
}

TEST_F(OpenConnectionsTest, ForgetsWhatAConnectionReceivedSecondsAgo) {
  Connection earlier, now;
  for (Connection* each : {&earlier, &now}) Connect(*each);
  earlier.Send(30'000);
  ReceivedBytes received(ntohs(address_.sin_port));
  for (int second = 0; second < 2; ++second) received.Note(begin_ + seconds(second));
  now.Send(20'000);
  int64_t recent = 0;
  for (const auto& [peer, bytes] : received.Recent()) recent += bytes;
  EXPECT_EQ(recent, 20'000);
  EXPECT_EQ(received.Recent().size(), 2u);
  EXPECT_EQ(received.CutOffLargest(1000), 1);
  EXPECT_TRUE(now.IsCutOff());
  EXPECT_FALSE(earlier.IsCutOff());
}

TEST_F(OpenConnectionsTest, ShutsTheNewestConnectionsDownIfThereAreTooMany) {
  Connection first, second, third, fourth;
  ConnectionLimit limit(ntohs(address_.sin_port), 2);
  for (Connection* each : {&first, &second}) Connect(*each);
  EXPECT_EQ(limit.Enforce(), 0);
  for (Connection* each : {&third, &fourth}) Connect(*each);
  EXPECT_EQ(limit.Enforce(), 2);
  EXPECT_TRUE(third.IsCutOff() && fourth.IsCutOff());
  EXPECT_FALSE(first.IsCutOff() || second.IsCutOff());
  EXPECT_EQ(limit.Enforce(), 0) << "they are shut down already";

  // One with a lower descriptor than a connection that was there before it is newer, too.
  const int lower = first.accepted;
  close(first.caller);
  close(first.accepted);
  Connection last;
  Connect(first);
  Connect(last);
  EXPECT_LT(std::min(first.accepted, last.accepted), second.accepted) << lower << " is free";
  EXPECT_EQ(limit.Enforce(), 1);
  EXPECT_FALSE(second.IsCutOff());
}

TEST_F(OpenConnectionsTest, NoMoreConnectionsAreAffordableThanHalfOfTheFiles) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit few = {300, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &few), 0);
  EXPECT_EQ(AffordableConnections(4096), 150);
  EXPECT_EQ(AffordableConnections(100), 100);
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
}

TEST_F(OpenConnectionsTest, TellsWhatTheConnectionOfACallerReceived) {
  Connection first, second;
  for (Connection* each : {&first, &second}) Connect(*each);
  const auto peer_of = [](const Connection& connection) {
    sockaddr_in own{};
    socklen_t size = sizeof own;
    getsockname(connection.caller, AsAddress(own), &size);
    return "ipv4:127.0.0.1:" + std::to_string(ntohs(own.sin_port));
  };
  ReceivedByPeer received(ntohs(address_.sin_port));
  first.Send(30'000);
  EXPECT_EQ(received.Bytes(peer_of(first)), 30'000);
  EXPECT_EQ(received.Bytes(peer_of(second)), 0);
  EXPECT_EQ(received.Bytes("ipv4:127.0.0.1:1"), 0);
  first.Send(1'000);
  EXPECT_EQ(received.Bytes(peer_of(first)), 31'000);
  // Another connection gets the descriptor.
  const std::string gone = peer_of(first);
  close(first.caller);
  close(first.accepted);
  Connect(first);
  EXPECT_EQ(received.Bytes(gone), 0);
  first.Send(10);
  EXPECT_EQ(received.Bytes(peer_of(first)), 10);
}

// As gRPC 1.51 names its callers.
TEST(PeerNameTest, HasTheLinkOfALinkLocalAddress) {
  const auto name = [](const char* address, uint32_t link) {
    sockaddr_storage peer{};
    auto& of_ip6 = reinterpret_cast<sockaddr_in6&>(peer);
    of_ip6.sin6_family = AF_INET6;
    of_ip6.sin6_port = htons(4567);
    of_ip6.sin6_scope_id = link;
    EXPECT_EQ(inet_pton(AF_INET6, address, &of_ip6.sin6_addr), 1);
    return PeerName(peer);
  };
  EXPECT_EQ(name("fe80::1", 2), "ipv6:%5Bfe80::1%252%5D:4567");
  EXPECT_EQ(name("::1", 0), "ipv6:%5B::1%5D:4567");
  EXPECT_EQ(name("::ffff:127.0.0.1", 0), "ipv4:127.0.0.1:4567");
}

}  // namespace
}  // namespace maneuver::rpc::open_connections_test
