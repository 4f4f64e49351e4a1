#include "client/cli/tls_failure.h"

#include <openssl/bio.h>
#include <openssl/ssl.h>
#include <openssl/x509_vfy.h>

#include <ctime>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace maneuver::cli {
namespace {

constexpr int kMostSeconds = 2;
constexpr int kNapMilliseconds = 20;
constexpr unsigned char kHttp2[] = {2, 'h', '2'};  // as ALPN writes it: length, name

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

// What a connection to the server shows.
struct Probe {
  bool has_handshake = false;  // the server speaks TLS
  long verify_result = X509_V_OK;
  bool wants_certificate = false;
  bool is_accepted = false;  // the server has sent data, so it accepts the client's certificate
};

int RememberRequest(SSL*, void* wants_certificate) {
  *static_cast<bool*>(wants_certificate) = true;
  return 1;
}

Probe Connect(const std::string& server, const client::TlsOptions& tls) {
  Probe probe;
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()),
                                                                  SSL_CTX_free);
  if (context == nullptr) return probe;
  const int loaded =
      tls.root_certificates.empty()
          ? SSL_CTX_set_default_verify_paths(context.get())
          : SSL_CTX_load_verify_locations(context.get(), tls.root_certificates.c_str(), nullptr);
  if (loaded != 1) return probe;
  if (!tls.certificate.empty()) {
    SSL_CTX_use_certificate_chain_file(context.get(), tls.certificate.c_str());
    SSL_CTX_use_PrivateKey_file(context.get(), tls.key.c_str(), SSL_FILETYPE_PEM);
  }
  SSL_CTX_set_cert_cb(context.get(), RememberRequest, &probe.wants_certificate);
  // The handshake goes on after a certificate that does not verify; its result is what is asked.
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_NONE, nullptr);
  // gRPC closes connections that do not offer HTTP/2.
  SSL_CTX_set_alpn_protos(context.get(), kHttp2, sizeof(kHttp2));
  const std::unique_ptr<BIO, decltype(&BIO_free_all)> connection(BIO_new_ssl_connect(context.get()),
                                                                 BIO_free_all);
  if (connection == nullptr) return probe;
  BIO_set_conn_hostname(connection.get(), server.c_str());
  if (BIO_do_connect_retry(connection.get(), kMostSeconds, kNapMilliseconds) != 1) return probe;
  SSL* ssl = nullptr;
  BIO_get_ssl(connection.get(), &ssl);
  if (ssl == nullptr) return probe;
  probe.has_handshake = true;
  probe.verify_result = SSL_get_verify_result(ssl);
  // A server refuses a client's certificate only after the handshake.
  const std::time_t end = std::time(nullptr) + kMostSeconds;
  char byte = 0;
  int read = 0;
  do {
    read = BIO_read(connection.get(), &byte, 1);
  } while (read <= 0 && BIO_should_retry(connection.get()) != 0 &&
           BIO_wait(connection.get(), end, kNapMilliseconds) == 1);
  probe.is_accepted = read == 1;
  return probe;
}

// Returns why a server closed the connection without an answer; empty if TLS is not the cause.
std::string ExplainClosing(const std::string& server,
                           const std::optional<client::TlsOptions>& tls) {
  const Probe probe = Connect(server, tls.value_or(client::TlsOptions{}));
  if (!probe.has_handshake) return "";
  if (!tls) {
    return absl::StrCat("the server at ", server,
                        " serves over TLS; add --tls-ca FILE with its authority, or --tls to trust "
                        "the system's authorities");
  }
  if (!probe.wants_certificate || probe.is_accepted) return "";
  if (tls->certificate.empty()) {
    return absl::StrCat("the server at ", server,
                        " requires a client certificate; name it with --tls-certificate and its "
                        "key with --tls-key");
  }
  return absl::StrCat("the server at ", server, " refuses the client certificate in ",
                      tls->certificate,
                      "; it must be valid and from an authority that the server trusts");
}

}  // namespace

std::string ExplainTlsFailure(const std::string& message, const std::string& server,
                              const std::optional<client::TlsOptions>& tls) {
  if (absl::StrContains(message, "is not in peer certificate")) {
    return absl::StrCat("the certificate of the server at ", server,
                        " is for another name; call it by that name with --server, or give the "
                        "name with --tls-server-name");
  }
  if (tls && absl::StrContains(message, "certificate verify failed")) {
    const std::string problem = Problem(Connect(server, *tls).verify_result);
    return absl::StrCat(
        "the certificate of the server at ", server, " is not trusted: ",
        problem.empty() ? "it is from another authority, or not valid now" : problem,
        tls->root_certificates.empty()
            ? "; --tls-ca FILE names an authority to trust"
            : absl::StrCat("; it must be valid and from an authority in ", tls->root_certificates));
  }
  if (absl::StrContains(message, "wrong version number")) {
    return absl::StrCat("the server at ", server,
                        " does not serve over TLS; leave out --tls and all options that begin "
                        "with it");
  }
  if (absl::StrContains(message, "Socket closed") ||
      absl::StrContains(message, "Connection reset")) {
    return ExplainClosing(server, tls);
  }
  return "";
}

}  // namespace maneuver::cli
