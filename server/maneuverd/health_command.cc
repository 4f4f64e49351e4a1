#include "server/maneuverd/health_command.h"

#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_certificate_verifier.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <chrono>
#include <cstdlib>
#include <future>
#include <iostream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "model/files/durable_file.h"
#include "server/maneuverd/options.h"

namespace maneuver {
namespace {

constexpr int kNotServing = 1;
constexpr int kCannotAsk = 2;
constexpr std::chrono::seconds kPatience{4};  // less than the five seconds that probes have

int Report(int status, const std::string& message) {
  std::cerr << "maneuverd health: " << message << "\n";
  return status;
}

// Whoever listens everywhere is asked from here.
security::ListenAddress Reachable(security::ListenAddress address) {
  if (address.host == "0.0.0.0") address.host = "127.0.0.1";
  if (address.host == "::") address.host = "::1";
  return address;
}

// The certificate that servers with --tls-client-ca ask for, from where the command `maneuver`
// reads it. Nothing if none is named.
absl::StatusOr<std::vector<grpc::experimental::IdentityKeyCertPair>> OwnCertificate() {
  const char* certificate = std::getenv("MANEUVER_TLS_CERTIFICATE");
  const char* key = std::getenv("MANEUVER_TLS_KEY");
  std::vector<grpc::experimental::IdentityKeyCertPair> pairs;
  if (certificate == nullptr || key == nullptr) return pairs;
  auto certificate_pem = files::ReadInput(certificate);
  if (!certificate_pem.ok()) return certificate_pem.status();
  auto key_pem = files::ReadInput(key);
  if (!key_pem.ok()) return key_pem.status();
  pairs.push_back({*std::move(key_pem), *std::move(certificate_pem)});
  return pairs;
}

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> Credentials(
    const ServerOptions& options) {
  if (!options.tls) return grpc::InsecureChannelCredentials();
  // The question and the answer are not secret, and it is this machine that is asked, by an address
  // that its certificate need not name.
  grpc::experimental::TlsChannelCredentialsOptions tls;
  tls.set_verify_server_certs(false);
  tls.set_check_call_host(false);
  tls.set_certificate_verifier(std::make_shared<grpc::experimental::NoOpCertificateVerifier>());
  auto own = OwnCertificate();
  if (!own.ok()) return own.status();
  if (!own->empty()) {
    tls.set_certificate_provider(
        std::make_shared<grpc::experimental::StaticDataCertificateProvider>(*own));
    tls.watch_identity_key_cert_pairs();
  }
  return grpc::experimental::TlsCredentials(tls);
}

int Ask(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
  // HealthCheckRequest {string service = 1} and HealthCheckResponse {enum status = 1} of
  // grpc.health.v1 have the bytes of these two; distributions do not ship health.proto.
  grpc::TemplatedGenericStub<google::protobuf::StringValue, google::protobuf::Int32Value> stub(
      channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  google::protobuf::StringValue request;
  request.set_value(service);
  google::protobuf::Int32Value response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, "/grpc.health.v1.Health/Check", {}, &request, &response,
                 [&done](grpc::Status status) { done.set_value(std::move(status)); });
  const grpc::Status status = done.get_future().get();
  if (!status.ok()) return Report(kNotServing, status.error_message());
  constexpr int kServing = 1;
  if (response.value() != kServing) {
    return Report(kNotServing,
                  (service.empty() ? "the server" : service) + " is not ready to serve");
  }
  std::cout << "SERVING" << std::endl;
  return 0;
}

// The service is named first, or last where that is not the value of the option before it.
bool IsService(int argc, const char* const* argv, int i) {
  if (absl::StartsWith(argv[i], "-")) return false;
  if (i == 1) return true;
  const bool is_value = absl::StartsWith(argv[i - 1], "-") && !absl::StrContains(argv[i - 1], '=');
  return i == argc - 1 && !is_value;
}

}  // namespace

int RunHealthCommand(int argc, const char* const* argv, const char* const* environment) {
  std::string service;
  std::vector<const char*> server_line = {"maneuverd"};
  for (int i = 1; i < argc; ++i) {
    if (IsService(argc, argv, i)) {
      service = argv[i];
    } else {
      server_line.push_back(argv[i]);
    }
  }
  const auto parsed =
      ParseCommandLine(static_cast<int>(server_line.size()), server_line.data(), environment,
                       /*needs_data_dir=*/false);
  if (const int* status = std::get_if<int>(&parsed)) return *status;
  const auto& options = std::get<ServerOptions>(parsed);
  if (options.listen.port == 0) {
    return Report(kCannotAsk,
                  "--listen: port 0 stands for any port; name the port that the server listens on");
  }
  const auto credentials = Credentials(options);
  if (!credentials.ok()) return Report(kCannotAsk, std::string(credentials.status().message()));
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  return Ask(
      grpc::CreateCustomChannel(Reachable(options.listen).ToString(), *credentials, arguments),
      service);
}

}  // namespace maneuver
