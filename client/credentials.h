// Private to the library: how a channel is secured, and the credentials of each call.

#ifndef MANEUVER_CLIENT_CREDENTIALS_H_
#define MANEUVER_CLIENT_CREDENTIALS_H_

#include <grpcpp/security/credentials.h>

#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "client/client_options.h"

namespace maneuver::client {

struct ClientCredentials {
  std::shared_ptr<grpc::ChannelCredentials> channel;
  std::string authorization;  // header of each call; empty: none
};

// Reads the files that the options name. INVALID_ARGUMENT, NOT_FOUND or FAILED_PRECONDITION say
// what is wrong with them.
absl::StatusOr<ClientCredentials> LoadCredentials(const ClientOptions& options);

// Returns whether the traffic stays on this machine: unix:..., localhost, 127.0.0.0/8 or [::1];
// with several servers, all of them.
bool IsLocal(std::string_view address);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CREDENTIALS_H_
