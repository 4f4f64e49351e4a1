// Private to the library: one server, or several that answer alike.

#ifndef MANEUVER_CLIENT_SERVER_ADDRESS_H_
#define MANEUVER_CLIENT_SERVER_ADDRESS_H_

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::client {

// Where a server listens unless it is told otherwise.
inline constexpr char kDefaultPort[] = "8470";

struct ServerAddress {
  std::string target;            // as gRPC takes it
  bool several = false;          // calls go to those in turn that are ready
  std::vector<std::string> all;  // each as it was given, without a scheme
};

// ClientOptions::address. A single server or name without a port gets kDefaultPort.
// INVALID_ARGUMENT says what is wrong with it.
absl::StatusOr<ServerAddress> ParseServerAddress(std::string_view address);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_SERVER_ADDRESS_H_
