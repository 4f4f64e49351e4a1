#include "server/rpc/open_connections.h"

#include <netinet/in.h>
#include <sys/socket.h>

#include <filesystem>
#include <system_error>

#include "absl/strings/numbers.h"

namespace maneuver::rpc {
namespace {

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

}  // namespace

void CutOffConnections(int port) {
  std::error_code error;
  std::filesystem::directory_iterator entry("/proc/self/fd", error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    int descriptor = -1;
    if (!absl::SimpleAtoi(entry->path().filename().string(), &descriptor)) continue;
    if (PortOfConnection(descriptor) == port) shutdown(descriptor, SHUT_RDWR);
  }
}

}  // namespace maneuver::rpc
