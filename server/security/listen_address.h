// The address that a server listens on.

#ifndef MANEUVER_SERVER_SECURITY_LISTEN_ADDRESS_H_
#define MANEUVER_SERVER_SECURITY_LISTEN_ADDRESS_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace maneuver::security {

struct ListenAddress {
  std::string host;  // without brackets
  int port = 0;      // 0: any free one

  // Returns HOST:PORT, an IPv6 host in brackets.
  std::string ToString() const;
};

// Parses HOST:PORT or [IPV6]:PORT. Errors: INVALID_ARGUMENT.
absl::StatusOr<ListenAddress> ParseListenAddress(std::string_view text);

// Returns whether only this machine can reach the address: 127.0.0.0/8, ::1 or localhost.
bool IsLoopback(const ListenAddress& address);

// Checks that plain text stays on this machine. FAILED_PRECONDITION unless the address is loopback,
// the traffic is encrypted, or `insecure` was given.
absl::Status CheckExposure(const ListenAddress& address, bool encrypted, bool insecure);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_LISTEN_ADDRESS_H_
