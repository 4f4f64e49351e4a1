#include "server/rpc/open_connections.h"

#include <linux/tcp.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"

namespace maneuver::rpc {
namespace {

constexpr int kEstablished = 1;  // TCP_ESTABLISHED, which linux/tcp.h leaves to another header

// The local port of a connected TCP socket; 0 of anything else.
int PortOfConnection(int descriptor) {
  sockaddr_storage peer{};
  socklen_t size = sizeof peer;
  if (getpeername(descriptor, reinterpret_cast<sockaddr*>(&peer), &size) != 0) return 0;
  sockaddr_storage local{};
  size = sizeof local;
  if (getsockname(descriptor, reinterpret_cast<sockaddr*>(&local), &size) != 0) return 0;
  if (local.ss_family == AF_INET) {
    return ntohs(reinterpret_cast<const sockaddr_in&>(local).sin_port);
  }
  if (local.ss_family == AF_INET6) {
    return ntohs(reinterpret_cast<const sockaddr_in6&>(local).sin6_port);
  }
  return 0;
}

// Calls `call` with the descriptor of each TCP connection that was accepted on `port`.
template <typename Call>
void ForEachConnection(int port, const Call& call) {
  std::error_code error;
  std::filesystem::directory_iterator entry("/proc/self/fd", error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    int descriptor = -1;
    if (!absl::SimpleAtoi(entry->path().filename().string(), &descriptor)) continue;
    if (PortOfConnection(descriptor) == port) call(descriptor);
  }
}

// All zero where the kernel does not tell.
tcp_info InfoOf(int descriptor) {
  tcp_info info{};
  socklen_t size = sizeof info;
  if (getsockopt(descriptor, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return {};
  return info;
}

}  // namespace

void CutOffConnections(int port) {
  ForEachConnection(port, [](int descriptor) { shutdown(descriptor, SHUT_RDWR); });
}

ReceivedBytes::Totals ReceivedBytes::Read() const {
  Totals totals;
  ForEachConnection(port_, [&totals](int descriptor) {
    totals[descriptor] = static_cast<int64_t>(InfoOf(descriptor).tcpi_bytes_received);
  });
  return totals;
}

void ReceivedBytes::Note(std::chrono::steady_clock::time_point now) {
  constexpr std::chrono::seconds kPeriod{1};
  if (now - noted_ < kPeriod) return;
  noted_ = now;
  before_ = std::exchange(latest_, Read());
}

ReceivedBytes::Totals ReceivedBytes::ReadRecent() const {
  Totals recent = Read();
  for (auto& [descriptor, total] : recent) {
    const auto before = before_.find(descriptor);
    // A descriptor may be that of another connection by now.
    if (before != before_.end() && before->second <= total) total -= before->second;
  }
  return recent;
}

int64_t ReceivedBytes::Recent() const {
  int64_t sum = 0;
  for (const auto& [descriptor, bytes] : ReadRecent()) sum += bytes;
  return sum;
}

int ReceivedBytes::CutOffLargest(int64_t left) const {
  std::vector<std::pair<int64_t, int>> received;  // with the descriptor
  int64_t sum = 0;
  for (const auto& [descriptor, bytes] : ReadRecent()) {
    received.emplace_back(bytes, descriptor);
    sum += bytes;
  }
  std::ranges::sort(received, std::greater());
  int cut = 0;
  for (const auto& [bytes, descriptor] : received) {
    if (sum <= left) break;
    sum -= bytes;
    // gRPC may need a while to close those that were cut off before.
    if (PortOfConnection(descriptor) != port_) continue;
    if (InfoOf(descriptor).tcpi_state != kEstablished) continue;
    shutdown(descriptor, SHUT_RDWR);
    ++cut;
  }
  return cut;
}

}  // namespace maneuver::rpc
