// The server's certificate and key, and whose client certificates it trusts: read from PEM files,
// checked before they are used, and read again when they change.

#ifndef MANEUVER_SERVER_SECURITY_CERTIFICATES_H_
#define MANEUVER_SERVER_SECURITY_CERTIFICATES_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::security {

struct CertificateFiles {
  std::filesystem::path certificate;  // the server's, followed by intermediate ones
  std::filesystem::path key;          // of the certificate, without a passphrase
  std::filesystem::path client_ca;    // empty: clients need no certificate
};

struct CertificateSet {
  std::string certificate;  // PEM, as are the others
  std::string key;
  std::string client_ca;  // empty: none
  std::chrono::system_clock::time_point expires;
  int64_t generation = 0;  // grows with each change
};

// Reads and checks: each file parses, the key is the certificate's and is not open to other users.
// Errors name the file and say what to do. An expired certificate is no error: see `expires`.
absl::StatusOr<CertificateSet> LoadCertificates(const CertificateFiles& files);

// Thread-safe.
class CertificateStore {
 public:
  static absl::StatusOr<std::shared_ptr<CertificateStore>> Open(const CertificateFiles& files);

  std::shared_ptr<const CertificateSet> Current() const;
  bool asks_for_client_certificates() const { return !files_.client_ca.empty(); }

  // Looks at the files again. False if they are as they were. After an error, such as a certificate
  // that was replaced while its key was not yet, the set before stays.
  absl::StatusOr<bool> Reload();

 private:
  explicit CertificateStore(const CertificateFiles& files) : files_(files) {}

  const CertificateFiles files_;
  mutable std::mutex mutex_;  // guards what follows
  std::shared_ptr<const CertificateSet> current_;
};

// Whole days until then, rounded down: negative once it has passed.
int DaysUntil(std::chrono::system_clock::time_point expires,
              std::chrono::system_clock::time_point now);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_CERTIFICATES_H_
