// Explains why a TLS connection to a server failed.

#ifndef MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
#define MANEUVER_CLIENT_CLI_TLS_FAILURE_H_

#include <string>

namespace maneuver::cli {

// Returns what was wrong with a failed TLS handshake, and what to do about it; empty if `message`
// is not about a handshake. gRPC does not say why it refused a certificate. So this connects to the
// server once more, for at most two seconds, and asks OpenSSL.
//   message: gRPC's message for the failed call.
//   server: HOST:PORT. Without a port, or with several servers, the explanation stays general.
//   authority: PEM file of the authority that must have signed the server's certificate; empty: the
//     system's authorities.
std::string ExplainTlsFailure(const std::string& message, const std::string& server,
                              const std::string& authority);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
