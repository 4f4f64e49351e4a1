#include "client/cli/tls_failure.h"

#include <openssl/bio.h>
#include <openssl/ssl.h>
#include <openssl/x509_vfy.h>

#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace maneuver::cli {
namespace {

constexpr int kMostSeconds = 2;
constexpr int kNapMilliseconds = 20;

std::string Problem(long verify_result) {
  switch (verify_result) {
    case X509_V_OK:
      return "";
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return "it has expired";
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return "it is not valid yet";
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_CERT_SIGNATURE_FAILURE:
      return "it is from another authority";
    default:
      return X509_verify_cert_error_string(verify_result);
  }
}

// What OpenSSL finds wrong with the server's certificate, such as "it has expired"; empty if the
// server cannot be asked, or if nothing is wrong.
std::string CertificateProblem(const std::string& server, const std::string& authority) {
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()),
                                                                  SSL_CTX_free);
  if (context == nullptr) return "";
  const int loaded = authority.empty()
                         ? SSL_CTX_set_default_verify_paths(context.get())
                         : SSL_CTX_load_verify_locations(context.get(), authority.c_str(), nullptr);
  if (loaded != 1) return "";
  // The handshake goes on after a certificate that does not verify; its result is what is asked.
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_NONE, nullptr);
  const std::unique_ptr<BIO, decltype(&BIO_free_all)> connection(BIO_new_ssl_connect(context.get()),
                                                                 BIO_free_all);
  if (connection == nullptr) return "";
  BIO_set_conn_hostname(connection.get(), server.c_str());
  if (BIO_do_connect_retry(connection.get(), kMostSeconds, kNapMilliseconds) != 1) return "";
  SSL* ssl = nullptr;
  BIO_get_ssl(connection.get(), &ssl);
  if (ssl == nullptr) return "";
  return Problem(SSL_get_verify_result(ssl));
}

}  // namespace

std::string ExplainTlsFailure(const std::string& message, const std::string& server,
                              const std::string& authority) {
  if (absl::StrContains(message, "is not in peer certificate")) {
    return absl::StrCat("the certificate of the server at ", server,
                        " is for another name; call it by that name with --server, or give the "
                        "name with --tls-server-name (",
                        message, ")");
  }
  if (absl::StrContains(message, "certificate verify failed")) {
    const std::string problem = CertificateProblem(server, authority);
    return absl::StrCat(
        "the certificate of the server at ", server, " is not trusted: ",
        problem.empty() ? "it is from another authority, or not valid now" : problem,
        authority.empty()
            ? "; --tls-ca FILE names an authority to trust"
            : absl::StrCat("; it must be valid and from an authority in ", authority));
  }
  if (absl::StrContains(message, "wrong version number")) {
    return absl::StrCat(
        "the server at ", server,
        " does not serve over TLS; leave out --tls and all options that begin with it (", message,
        ")");
  }
  return "";
}

}  // namespace maneuver::cli
