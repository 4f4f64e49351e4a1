// TLS for gRPC, with certificates that may change while the server runs.

#ifndef MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_
#define MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_

#include <grpcpp/security/server_credentials.h>

#include <memory>

#include "server/security/certificates.h"

namespace maneuver::rpc {

// Each new connection is greeted with the store's current certificates; those there are keep
// theirs, and their calls. If the store has a client CA, whoever has no certificate of it does not
// get through the handshake. TLS 1.2 or later.
//
// (gRPC's own FileWatcherCertificateProvider takes up a new certificate with an old key if it looks
// in between, and then refuses every connection until it looks again.)
//
// For one server, which it outlives.
std::shared_ptr<grpc::ServerCredentials> ReloadingServerCredentials(
    std::shared_ptr<const security::CertificateStore> certificates);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_SERVER_CREDENTIALS_H_
