#include "server/security/certificates.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <ctime>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"
#include "server/security/secret_file.h"

namespace maneuver::security {
namespace {

namespace fs = std::filesystem;

struct Free {
  void operator()(BIO* bio) const { BIO_free(bio); }
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
using BioPtr = std::unique_ptr<BIO, Free>;
using X509Ptr = std::unique_ptr<X509, Free>;
using KeyPtr = std::unique_ptr<EVP_PKEY, Free>;

BioPtr Open(const std::string& pem) {
  return BioPtr(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

// Returns no passphrase: a key must not have one.
int NoPassphrase(char*, int, int, void*) { return 0; }

absl::Status Wrong(const fs::path& file, const std::string& what) {
  ERR_clear_error();
  return absl::InvalidArgumentError(absl::StrCat(files::NameOf(file), " ", what));
}

// Parses every certificate of the file and returns the first.
absl::StatusOr<X509Ptr> FirstCertificate(const fs::path& file, const std::string& pem) {
  const BioPtr bio = Open(pem);
  X509Ptr first(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr));
  if (first == nullptr) return Wrong(file, "holds no certificate in PEM format");
  while (X509Ptr(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) != nullptr) {
  }
  if (ERR_GET_REASON(ERR_peek_last_error()) != PEM_R_NO_START_LINE) {
    return Wrong(file, "is damaged after its first certificate");
  }
  ERR_clear_error();
  return first;
}

absl::StatusOr<std::chrono::system_clock::time_point> ExpiryOf(const fs::path& file,
                                                               const X509& certificate) {
  std::tm time{};
  if (ASN1_TIME_to_tm(X509_get0_notAfter(&certificate), &time) != 1) {
    return Wrong(file, "has no readable end of validity");
  }
  return std::chrono::system_clock::from_time_t(timegm(&time));
}

}  // namespace

absl::StatusOr<CertificateSet> LoadCertificates(const CertificateFiles& files) {
  CertificateSet set;
  auto certificate_pem = ReadReloadedFile(files.certificate);
  if (!certificate_pem.ok()) return certificate_pem.status();
  auto key_pem = ReadSecretFile(files.key);
  if (!key_pem.ok()) return key_pem.status();
  set.certificate = *std::move(certificate_pem);
  set.key = *std::move(key_pem);

  const auto certificate = FirstCertificate(files.certificate, set.certificate);
  if (!certificate.ok()) return certificate.status();
  const KeyPtr key(PEM_read_bio_PrivateKey(Open(set.key).get(), nullptr, NoPassphrase, nullptr));
  if (key == nullptr) {
    return Wrong(files.key, "holds no private key in PEM format, or one with a passphrase");
  }
  if (X509_check_private_key(certificate->get(), key.get()) != 1) {
    return Wrong(files.key, absl::StrCat("is not the key of the certificate in ",
                                         files::NameOf(files.certificate)));
  }
  auto expires = ExpiryOf(files.certificate, **certificate);
  if (!expires.ok()) return expires.status();
  set.expires = *expires;

  if (!files.client_ca.empty()) {
    auto ca_pem = ReadReloadedFile(files.client_ca);
    if (!ca_pem.ok()) return ca_pem.status();
    set.client_ca = *std::move(ca_pem);
    const auto ca = FirstCertificate(files.client_ca, set.client_ca);
    if (!ca.ok()) return ca.status();
  }
  return set;
}

absl::StatusOr<std::shared_ptr<CertificateStore>> CertificateStore::Open(
    const CertificateFiles& files) {
  std::shared_ptr<CertificateStore> store(new CertificateStore(files));
  if (const auto loaded = store->Reload(); !loaded.ok()) return loaded.status();
  return store;
}

std::shared_ptr<const CertificateSet> CertificateStore::Current() const {
  const MutexLock lock(mutex_);
  return current_;
}

absl::StatusOr<bool> CertificateStore::Reload() {
  auto loaded = LoadCertificates(files_);
  if (!loaded.ok()) return loaded.status();
  const auto before = Current();
  if (before != nullptr && before->certificate == loaded->certificate &&
      before->key == loaded->key && before->client_ca == loaded->client_ca) {
    return false;
  }
  loaded->generation = before == nullptr ? 1 : before->generation + 1;
  const MutexLock lock(mutex_);
  current_ = std::make_shared<const CertificateSet>(*std::move(loaded));
  return true;
}

int DaysUntil(std::chrono::system_clock::time_point expires,
              std::chrono::system_clock::time_point now) {
  return std::chrono::floor<std::chrono::days>(expires - now).count();
}

}  // namespace maneuver::security
