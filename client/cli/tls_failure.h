// Explains why a TLS connection to a server failed.

#ifndef MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
#define MANEUVER_CLIENT_CLI_TLS_FAILURE_H_

#include <optional>
#include <string>

#include "client/client_options.h"

namespace maneuver::cli {

// Returns why TLS between this command and a server failed, and what to do about it; empty if TLS
// is not the cause. gRPC says little about the cause. So this connects to the server once more, for
// at most four seconds, and asks OpenSSL.
//   message: gRPC's message for the failed call.
//   server: HOST:PORT. Without a port, or with several servers, the explanation stays general.
//   tls: how the call was secured; none for plain text.
std::string ExplainTlsFailure(const std::string& message, const std::string& server,
                              const std::optional<client::TlsOptions>& tls);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
