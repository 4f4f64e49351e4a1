#include "server/rpc/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <array>

#include "absl/strings/str_cat.h"
#include "server/rpc/call_metrics.h"

namespace maneuver::rpc {
namespace {

constexpr int kMaxReceiveBytes = 64 << 20;
constexpr char kPredictionService[] = "maneuver.v1.PredictionService";
constexpr std::array kOtherServices = {"", "maneuver.v1.ModelService", "maneuver.v1.DatasetService",
                                       "maneuver.v1.TrainingService"};

// gRPC checks the size of a message after it was decompressed, which is too late: a few kilobytes
// can become gigabytes. Callers who compress get UNIMPLEMENTED.
void RefuseCompression(grpc::ServerBuilder& builder) {
  for (const grpc_compression_algorithm algorithm : {GRPC_COMPRESS_DEFLATE, GRPC_COMPRESS_GZIP}) {
    builder.SetCompressionAlgorithmSupportStatus(algorithm, false);
  }
}

}  // namespace

absl::StatusOr<std::unique_ptr<Server>> Server::Start(const security::ListenAddress& address,
                                                      const std::vector<grpc::Service*>& services,
                                                      monitoring::MetricRegistry& metrics) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  // Two servers on one port would share its calls: a taken port is an error instead.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  int port = 0;
  builder.AddListeningPort(address.ToString(), grpc::InsecureServerCredentials(), &port);
  builder.SetMaxReceiveMessageSize(kMaxReceiveBytes);
  RefuseCompression(builder);
  for (grpc::Service* service : services) builder.RegisterService(service);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
  interceptors.push_back(CountCalls(metrics));
  builder.experimental().SetInterceptorCreators(std::move(interceptors));

  std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (server == nullptr || port == 0) {
    return absl::UnavailableError(
        absl::StrCat("cannot listen on ", address.ToString(), ": is the port taken?"));
  }
  auto* health = server->GetHealthCheckService();
  health->SetServingStatus(kPredictionService, false);
  for (const char* service : kOtherServices) health->SetServingStatus(service, true);
  return std::unique_ptr<Server>(new Server(std::move(server), {address.host, port}));
}

Server::Server(std::unique_ptr<grpc::Server> server, security::ListenAddress address)
    : address_(std::move(address)), server_(std::move(server)) {}

Server::~Server() { server_->Shutdown(std::chrono::system_clock::now()); }

void Server::SetPredictionsReady(bool ready) {
  server_->GetHealthCheckService()->SetServingStatus(kPredictionService, ready);
}

void Server::TurnHealth() { server_->GetHealthCheckService()->Shutdown(); }

void Server::Shutdown(std::chrono::system_clock::time_point deadline) {
  server_->Shutdown(deadline);
}

}  // namespace maneuver::rpc
