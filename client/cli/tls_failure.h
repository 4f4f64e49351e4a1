// Why a server could not be talked to over TLS.

#ifndef MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
#define MANEUVER_CLIENT_CLI_TLS_FAILURE_H_

#include <string>

namespace maneuver::cli {

// Says what was wrong with a TLS handshake that failed, and what to do about it; empty if `message`
// tells of no such handshake. gRPC does not say why it refused a certificate, so this connects to
// the server once more, for at most two seconds, and asks OpenSSL.
//   message: of the call that failed, as gRPC words it.
//   server: HOST:PORT. Without a port, or of several servers, the reason stays general.
//   authority: PEM file of the authority that the server's certificate must be of; empty: the
//     system's.
std::string ExplainTlsFailure(const std::string& message, const std::string& server,
                              const std::string& authority);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TLS_FAILURE_H_
