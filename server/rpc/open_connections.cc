#include "server/rpc/open_connections.h"

#include <arpa/inet.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

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

// The caller of a connected TCP socket, as gRPC names it; empty of anything else.
std::string PeerOfConnection(int descriptor) {
  sockaddr_storage peer{};
  socklen_t size = sizeof peer;
  if (getpeername(descriptor, reinterpret_cast<sockaddr*>(&peer), &size) != 0) return "";
  return PeerName(peer);
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

std::string PeerName(const sockaddr_storage& peer) {
  char text[INET6_ADDRSTRLEN];
  if (peer.ss_family == AF_INET) {
    const auto& address = reinterpret_cast<const sockaddr_in&>(peer);
    inet_ntop(AF_INET, &address.sin_addr, text, sizeof text);
    return absl::StrCat("ipv4:", text, ":", ntohs(address.sin_port));
  }
  if (peer.ss_family != AF_INET6) return "";
  const auto& address = reinterpret_cast<const sockaddr_in6&>(peer);
  const int port = ntohs(address.sin6_port);
  if (IN6_IS_ADDR_V4MAPPED(&address.sin6_addr)) {
    inet_ntop(AF_INET, address.sin6_addr.s6_addr + 12, text, sizeof text);
    return absl::StrCat("ipv4:", text, ":", port);
  }
  inet_ntop(AF_INET6, &address.sin6_addr, text, sizeof text);
  const uint32_t link = address.sin6_scope_id;  // of a link-local address
  const std::string zone = link == 0 ? "" : absl::StrCat("%25", link);
  return absl::StrCat("ipv6:%5B", text, zone, "%5D:", port);
}

void CutOffConnections(int port) {
  ForEachConnection(port, [](int descriptor) { shutdown(descriptor, SHUT_RDWR); });
}

int CutOffConnections(int port, const std::set<std::string>& peers) {
  int cut = 0;
  if (peers.empty()) return cut;
  ForEachConnection(port, [&peers, &cut](int descriptor) {
    // gRPC may need a while to close those that were cut off before.
    if (InfoOf(descriptor).tcpi_state != kEstablished) return;
    if (!peers.contains(PeerOfConnection(descriptor))) return;
    shutdown(descriptor, SHUT_RDWR);
    ++cut;
  });
  return cut;
}

int64_t ReceivedByPeer::Bytes(const std::string& peer) {
  auto known = descriptors_.find(peer);
  // A descriptor may be that of another connection by now.
  if (known == descriptors_.end() || PeerOfConnection(known->second) != peer) {
    descriptors_.clear();
    ForEachConnection(
        port_, [this](int descriptor) { descriptors_[PeerOfConnection(descriptor)] = descriptor; });
    known = descriptors_.find(peer);
    if (known == descriptors_.end()) return 0;
  }
  return static_cast<int64_t>(InfoOf(known->second).tcpi_bytes_received);
}

ReceivedBytes::Totals ReceivedBytes::Read() const {
  Totals totals;
  ForEachConnection(port_, [&totals](int descriptor) {
    totals[descriptor] = static_cast<int64_t>(InfoOf(descriptor).tcpi_bytes_received);
  });
  return totals;
}

int AffordableConnections(int wanted) {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return wanted;
  return static_cast<int>(std::min<rlim_t>(static_cast<rlim_t>(wanted), files.rlim_cur / 2));
}

int ConnectionLimit::Enforce() {
  std::error_code error;
  int files = 0;
  std::filesystem::directory_iterator file("/proc/self/fd", error);
  for (; !error && file != std::filesystem::directory_iterator(); file.increment(error)) ++files;
  if (error || files <= most_) return 0;
  std::vector<std::pair<int, std::string>> open;  // descriptor and peer
  ForEachConnection(port_, [&open](int descriptor) {
    if (InfoOf(descriptor).tcpi_state == kEstablished) {
      open.emplace_back(descriptor, PeerOfConnection(descriptor));
    }
  });
  std::ranges::sort(open);
  std::stable_partition(open.begin(), open.end(),
                        [this](const auto& each) { return known_.contains(each); });
  const size_t stay = std::min(open.size(), static_cast<size_t>(most_));
  for (size_t i = stay; i < open.size(); ++i) {
    const auto& [descriptor, peer] = open[i];
    // By now it may be another file's.
    if (PeerOfConnection(descriptor) == peer) shutdown(descriptor, SHUT_RDWR);
  }
  known_ = {open.begin(), open.begin() + static_cast<std::ptrdiff_t>(stay)};
  return static_cast<int>(open.size() - stay);
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

std::map<std::string, int64_t> ReceivedBytes::Recent() const {
  std::map<std::string, int64_t> recent;
  for (const auto& [descriptor, bytes] : ReadRecent()) recent[PeerOfConnection(descriptor)] = bytes;
  return recent;
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
