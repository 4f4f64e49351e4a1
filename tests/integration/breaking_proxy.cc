#include "tests/integration/breaking_proxy.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <utility>

namespace maneuver::integration {
namespace {

constexpr int kPollMilliseconds = 50;

sockaddr_in Loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

// Small socket buffers, so that the proxy itself holds little data.
constexpr int kBufferBytes = 64 * 1024;

void MakeShort(int socket) {
  setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &kBufferBytes, sizeof kBufferBytes);
  setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &kBufferBytes, sizeof kBufferBytes);
}

// Resets the connection, as if the peer had gone.
void Break(int socket) {
  const linger at_once{.l_onoff = 1, .l_linger = 0};
  setsockopt(socket, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  close(socket);
}

bool SendAll(int socket, const char* bytes, ssize_t count) {
  while (count > 0) {
    const ssize_t sent = send(socket, bytes, static_cast<size_t>(count), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes += sent;
    count -= sent;
  }
  return true;
}

}  // namespace

BreakingProxy::BreakingProxy(const std::string& server, Breaks breaks)
    : breaks_(std::move(breaks)) {
  SetServer(server);
  listener_ = socket(AF_INET, SOCK_STREAM, 0);
  MakeShort(listener_);
  sockaddr_in address = Loopback(0);
  socklen_t length = sizeof address;
  EXPECT_EQ(bind(listener_, reinterpret_cast<sockaddr*>(&address), length), 0);
  EXPECT_EQ(listen(listener_, 16), 0);
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &length);
  port_ = ntohs(address.sin_port);
  accepting_ = std::thread([this] { Accept(); });
}

BreakingProxy::~BreakingProxy() {
  ends_ = true;
  accepting_.join();
  for (std::thread& thread : threads_) thread.join();
  close(listener_);
}

void BreakingProxy::SetServer(const std::string& server) {
  const std::lock_guard lock(mutex_);
  server_port_ = std::stoi(server.substr(server.rfind(':') + 1));
}

void BreakingProxy::Accept() {
  while (!ends_) {
    pollfd ready{.fd = listener_, .events = POLLIN, .revents = 0};
    if (poll(&ready, 1, kPollMilliseconds) <= 0) continue;
    const int client = accept(listener_, nullptr, nullptr);
    if (client < 0) continue;
    ++connections_;
    threads_.emplace_back([this, client] { Pass(client); });
  }
}

int BreakingProxy::ConnectToServer() {
  sockaddr_in address{};
  {
    const std::lock_guard lock(mutex_);
    address = Loopback(server_port_);
  }
  const int server = socket(AF_INET, SOCK_STREAM, 0);
  MakeShort(server);
  if (connect(server, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0) return server;
  close(server);
  return -1;
}

void BreakingProxy::Pass(int client) {
  const int server = ConnectToServer();
  std::array<char, 16 * 1024> buffer;
  while (server >= 0 && !ends_) {
    std::array<pollfd, 2> ready = {pollfd{.fd = client, .events = POLLIN, .revents = 0},
                                   pollfd{.fd = server, .events = POLLIN, .revents = 0}};
    if (poll(ready.data(), ready.size(), kPollMilliseconds) <= 0) continue;
    const bool from_client = ready[0].revents != 0;
    const ssize_t count = recv(from_client ? client : server, buffer.data(), buffer.size(), 0);
    if (count <= 0) break;
    if (from_client && breaks_(sent_ += count)) break;
    if (!SendAll(from_client ? server : client, buffer.data(), count)) break;
  }
  Break(client);
  if (server >= 0) Break(server);
}

}  // namespace maneuver::integration
