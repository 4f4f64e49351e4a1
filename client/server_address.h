// Private to the library: the address of one server, or of several equivalent ones.

#ifndef MANEUVER_CLIENT_SERVER_ADDRESS_H_
#define MANEUVER_CLIENT_SERVER_ADDRESS_H_

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::client {

// The port that a server listens on by default.
inline constexpr char kDefaultPort[] = "8470";

struct ServerAddress {
  std::string target;            // as gRPC takes it
  bool several = false;          // calls go in turn to those that are ready
  std::vector<std::string> all;  // each as it was given, without a scheme
};

// Parses ClientOptions::address. Adds kDefaultPort to a single server or name without a port.
// INVALID_ARGUMENT says what is wrong with it.
absl::StatusOr<ServerAddress> ParseServerAddress(std::string_view address);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_SERVER_ADDRESS_H_
