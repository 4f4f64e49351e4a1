// Opens the certificates and identities that protect a server, as its options say.

#ifndef MANEUVER_SERVER_MANEUVERD_PROTECTION_H_
#define MANEUVER_SERVER_MANEUVERD_PROTECTION_H_

#include <memory>

#include "absl/status/statusor.h"
#include "server/maneuverd/options.h"
#include "server/monitoring/metrics.h"
#include "server/security/access_control.h"
#include "server/security/certificates.h"
#include "server/security/periodic_reload.h"

namespace grpc {
class ServerCredentials;
}

namespace maneuver {

// Certificates and identities, read again every second. Must outlive the server.
class Protection {
 public:
  // Reads the files. Errors: those of CertificateStore::Open and AccessControl::Create; they name
  // the flag whose file is wrong. Logs a warning for what is allowed but unwise, such as no
  // --tokens.
  static absl::StatusOr<std::unique_ptr<Protection>> Open(const ServerOptions& options,
                                                          monitoring::MetricRegistry& metrics);

  security::AccessControl& access() { return *access_; }
  // Returns credentials for one server; nullptr for plain text.
  std::shared_ptr<grpc::ServerCredentials> credentials() const;

 private:
  Protection() = default;
  absl::StatusOr<bool> RenewCertificates();
  void TellExpiry();

  std::shared_ptr<security::CertificateStore> certificates_;  // nullptr: plain text
  monitoring::Gauge* expiry_ = nullptr;
  std::unique_ptr<security::AccessControl> access_;
  std::unique_ptr<security::PeriodicReload> reload_;  // last: ends before what it reloads
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_PROTECTION_H_
