// The server's certificate and key, and the authorities whose client certificates it trusts. They
// are read from PEM files, checked before use, and read again when the files change.

#ifndef MANEUVER_SERVER_SECURITY_CERTIFICATES_H_
#define MANEUVER_SERVER_SECURITY_CERTIFICATES_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"

namespace maneuver::security {

struct CertificateFiles {
  std::filesystem::path certificate;  // the server's, then intermediate ones
  std::filesystem::path key;          // of the certificate, without a passphrase
  std::filesystem::path client_ca;    // empty: clients need no certificate
};

struct CertificateSet {
  std::string certificate;  // PEM, as are the others
  std::string key;
  std::string client_ca;  // empty: none
  std::chrono::system_clock::time_point expires;
  int64_t generation = 0;  // increases with each change
};

// Reads and checks the files: each parses, the key matches the certificate, and other users cannot
// read the key. INVALID_ARGUMENT if a file does not parse or fit the others; otherwise errors of
// ReadSecretFile and of files. They name the file and say what to do. An expired certificate is not
// an error: see `expires`.
absl::StatusOr<CertificateSet> LoadCertificates(const CertificateFiles& files);

// Thread-safe.
class CertificateStore {
 public:
  // Reads the files. Errors of Open and Reload: those of LoadCertificates.
  static absl::StatusOr<std::shared_ptr<CertificateStore>> Open(const CertificateFiles& files);

  std::shared_ptr<const CertificateSet> Current() const;
  bool asks_for_client_certificates() const { return !files_.client_ca.empty(); }

  // Reads the files again. Returns false if they have not changed. After an error the old set
  // stays: for instance while the certificate has been replaced and the key has not.
  absl::StatusOr<bool> Reload();

 private:
  explicit CertificateStore(const CertificateFiles& files) : files_(files) {}

  const CertificateFiles files_;
  mutable Mutex mutex_;
  std::shared_ptr<const CertificateSet> current_ ABSL_GUARDED_BY(mutex_);
};

// Returns the whole days from `now` until `expires`, rounded down; negative once that has passed.
int DaysUntil(std::chrono::system_clock::time_point expires,
              std::chrono::system_clock::time_point now);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_CERTIFICATES_H_
