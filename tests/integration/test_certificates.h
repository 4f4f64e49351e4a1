#ifndef MANEUVER_TESTS_INTEGRATION_TEST_CERTIFICATES_H_
#define MANEUVER_TESTS_INTEGRATION_TEST_CERTIFICATES_H_

#include <openssl/evp.h>
#include <openssl/x509.h>

#include <memory>
#include <string>

namespace maneuver::integration {

struct TestCertificate {
  std::string certificate;  // PEM
  std::string key;          // PEM
};

// A certificate authority that lives as long as its test.
class TestAuthority {
 public:
  explicit TestAuthority(const std::string& name);

  const std::string& certificate() const { return certificate_; }  // PEM

  //   alternative_names: as OpenSSL writes them: "DNS:localhost,IP:127.0.0.1"; empty for none.
  //   days_left: negative for one that has expired.
  TestCertificate Issue(const std::string& common_name, const std::string& alternative_names,
                        int days_left = 10);

 private:
  struct Free {
    void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
    void operator()(X509* certificate) const { X509_free(certificate); }
  };
  using KeyPtr = std::unique_ptr<EVP_PKEY, Free>;
  using X509Ptr = std::unique_ptr<X509, Free>;

  // Returns a certificate signed by the authority, or by `key` itself while there is no authority
  // yet.
  X509Ptr Sign(EVP_PKEY* key, const std::string& common_name, const std::string& alternative_names,
               int days_left);

  KeyPtr key_;
  X509Ptr authority_;
  std::string certificate_;
  long serial_ = 0;
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_TEST_CERTIFICATES_H_
