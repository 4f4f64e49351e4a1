#include "client/credentials.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/server_address.h"

namespace maneuver::client {
namespace {

bool IsLocalHost(const std::string& address) {
  std::string host(address.substr(0, address.rfind(':')));
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
    host = host.substr(1, host.size() - 2);
  }
  in_addr v4{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  in6_addr v6{};
  if (inet_pton(AF_INET6, host.c_str(), &v6) == 1) return IN6_IS_ADDR_LOOPBACK(&v6) != 0;
  return host == "localhost";
}

// Returns the content of a certificate, a key or a token.
absl::StatusOr<std::string> ReadAll(const std::string& file) {
  constexpr size_t kMostBytes = size_t{16} << 20;  // the authorities of a system have 0.3 MB
  std::ifstream stream(file, std::ios::binary);
  std::string text;
  std::array<char, 4096> block{};
  do {
    stream.read(block.data(), block.size());
    text.append(block.data(), static_cast<size_t>(stream.gcount()));
    if (text.size() > kMostBytes) {
      return absl::InvalidArgumentError(absl::StrCat(file, " has more than 16 MiB"));
    }
  } while (stream.good());
  if (!stream.is_open() || stream.bad()) {
    return absl::NotFoundError(absl::StrCat(file, " cannot be read"));
  }
  if (text.empty()) return absl::InvalidArgumentError(absl::StrCat(file, " is empty"));
  return text;
}

constexpr std::string_view kCertificate = "CERTIFICATE-----";
constexpr std::string_view kPrivateKey = "PRIVATE KEY-----";

// Reads a PEM file; empty for no file.
//   kind: what it must contain, kCertificate or kPrivateKey.
absl::StatusOr<std::string> ReadPem(const std::string& file, std::string_view kind) {
  if (file.empty()) return std::string();
  auto pem = ReadAll(file);
  if (!pem.ok()) return pem;
  if (pem->find("-----BEGIN") == std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat(file, " is not in PEM format"));
  }
  if (pem->find(kind) != std::string::npos) return pem;
  const bool wants_key = kind == kPrivateKey;
  const bool holds_other = pem->find(wants_key ? kCertificate : kPrivateKey) != std::string::npos;
  return absl::InvalidArgumentError(
      absl::StrCat(file,
                   holds_other ? wants_key ? " holds a certificate, " : " holds a private key, "
                               : " holds something else, ",
                   wants_key ? "not a private key" : "not a certificate"));
}

using BioPtr = std::unique_ptr<BIO, decltype(&BIO_free_all)>;

BioPtr Open(const std::string& pem) {
  return {BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())), BIO_free_all};
}

// Returns no passphrase: gRPC has no way to ask for one.
int NoPassphrase(char*, int, int, void*) { return 0; }

// Checks a client certificate and its key, both PEM. With a wrong pair gRPC says only that it has
// no address to connect to.
absl::Status CheckPair(const TlsOptions& tls, const std::string& certificate_pem,
                       const std::string& key_pem) {
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(
      PEM_read_bio_X509(Open(certificate_pem).get(), nullptr, nullptr, nullptr), X509_free);
  const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(
      PEM_read_bio_PrivateKey(Open(key_pem).get(), nullptr, NoPassphrase, nullptr), EVP_PKEY_free);
  const bool fits = certificate != nullptr && key != nullptr &&
                    X509_check_private_key(certificate.get(), key.get()) == 1;
  ERR_clear_error();
  if (certificate == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("the certificate in ", tls.certificate, " is damaged"));
  }
  if (key == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("the key in ", tls.key, " is damaged, or has a passphrase"));
  }
  if (!fits) {
    return absl::InvalidArgumentError(
        absl::StrCat(tls.key, " is not the key of the certificate in ", tls.certificate));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> SecureChannel(const TlsOptions& tls) {
  if (tls.certificate.empty() != tls.key.empty()) {
    return absl::InvalidArgumentError("a client certificate and its key need one another");
  }
  auto roots = ReadPem(tls.root_certificates, kCertificate);
  if (!roots.ok()) return roots.status();
  auto certificate = ReadPem(tls.certificate, kCertificate);
  if (!certificate.ok()) return certificate.status();
  auto key = ReadPem(tls.key, kPrivateKey);
  if (!key.ok()) return key.status();
  if (!tls.certificate.empty()) {
    if (auto status = CheckPair(tls, *certificate, *key); !status.ok()) return status;
  }
  return grpc::SslCredentials({*std::move(roots), *std::move(key), *std::move(certificate)});
}

// Reads the token, without the white space that editors leave at the end of a file.
absl::StatusOr<std::string> ReadToken(const ClientOptions& options) {
  std::string token = options.token;
  if (!options.token_file.empty()) {
    auto text = ReadAll(options.token_file);
    if (!text.ok()) return text.status();
    token = *std::move(text);
    token.erase(token.find_last_not_of(" \t\r\n") + 1);
    if (token.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(options.token_file, " holds no token"));
    }
  }
  const bool is_visible = std::ranges::all_of(token, [](char c) { return c > ' ' && c < 0x7f; });
  if (!is_visible) {
    return absl::InvalidArgumentError("a token is one word of ASCII characters, and this is not");
  }
  return token;
}

}  // namespace

bool IsLocal(std::string_view address) {
  if (address.starts_with("unix:") || address.starts_with("unix-abstract:")) return true;
  const auto parsed = ParseServerAddress(address);
  return parsed.ok() && std::ranges::all_of(parsed->all, IsLocalHost);
}

absl::StatusOr<ClientCredentials> LoadCredentials(const ClientOptions& options) {
  ClientCredentials credentials;
  const auto token = ReadToken(options);
  if (!token.ok()) return token.status();
  if (!token->empty()) {
    if (!options.tls && !IsLocal(options.address)) {
      return absl::FailedPreconditionError(
          absl::StrCat("the token is not sent to ", options.address,
                       " in plain text, where others could read it; use TLS (--tls, or --tls-ca "
                       "with the server's authority)"));
    }
    credentials.authorization = absl::StrCat("Bearer ", *token);
  }
  if (!options.tls) {
    credentials.channel = grpc::InsecureChannelCredentials();
    return credentials;
  }
  auto channel = SecureChannel(*options.tls);
  if (!channel.ok()) return channel.status();
  credentials.channel = *std::move(channel);
  return credentials;
}

}  // namespace maneuver::client
