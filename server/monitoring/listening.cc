#include "server/monitoring/listening.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <system_error>

namespace maneuver::monitoring {
namespace {

// Binds a socket to the address for a moment. Returns 0 or errno.
int TryToBind(const addrinfo& place) {
  const int file = socket(place.ai_family, place.ai_socktype | SOCK_CLOEXEC, place.ai_protocol);
  if (file < 0) return errno;
  const int yes = 1;
  setsockopt(file, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  int error = bind(file, place.ai_addr, place.ai_addrlen) == 0 ? 0 : errno;
  // Of two that may reuse an address, the second fails only here.
  if (error == 0 && listen(file, 1) != 0) error = errno;
  close(file);
  return error;
}

}  // namespace

std::string WhyNotListening(const std::string& address) {
  const size_t colon = address.rfind(':');
  std::string host = address.substr(0, colon);
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  addrinfo wanted{};
  wanted.ai_socktype = SOCK_STREAM;
  wanted.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  const int unknown = getaddrinfo(host.c_str(), address.c_str() + colon + 1, &wanted, &found);
  if (unknown != 0) return "no host has this name (" + std::string(gai_strerror(unknown)) + ")";
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> places(found, freeaddrinfo);
  int error = 0;
  for (const addrinfo* place = found; place != nullptr && error == 0; place = place->ai_next) {
    error = TryToBind(*place);
  }
  switch (error) {
    case 0:
      return "the log says why";
    case EADDRINUSE:
      return "another program listens on this port";
    case EADDRNOTAVAIL:
      return "the address is not one of this machine's";
    case EACCES:
      return "ports below 1024 need a privilege";
    default:
      return std::generic_category().message(error);
  }
}

}  // namespace maneuver::monitoring
