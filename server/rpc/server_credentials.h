// TLS for gRPC, with certificates that may change while the server runs.

#ifndef MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_
#define MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_

#include <grpcpp/security/server_credentials.h>

#include <memory>

#include "server/security/certificates.h"

namespace maneuver::rpc {

// Returns credentials that give each new connection the store's current certificates. Existing
// connections keep theirs. If the store has a client CA, the handshake of a client without a
// certificate of that CA fails. Requires TLS 1.2 or later.
//
// (gRPC's own FileWatcherCertificateProvider can read a new certificate with the old key if both
// are being replaced. It then refuses every connection until it reads them again.)
//
// For one server, which must not outlive the result.
std::shared_ptr<grpc::ServerCredentials> ReloadingServerCredentials(
    std::shared_ptr<const security::CertificateStore> certificates);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_
