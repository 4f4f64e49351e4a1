// The gRPC server: services, health, reflection and call metrics on one port.

#ifndef MANEUVER_SERVER_RPC_SERVER_H_
#define MANEUVER_SERVER_RPC_SERVER_H_

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/monitoring/metrics.h"
#include "server/security/listen_address.h"

namespace grpc {
class Server;
class Service;
}  // namespace grpc

namespace maneuver::rpc {

class Server {
 public:
  // Listens and answers. Every service, and the server as a whole (""), is SERVING but
  // PredictionService, which is NOT_SERVING until SetPredictionsReady.
  //   services: outlive the server.
  // UNAVAILABLE if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<Server>> Start(const security::ListenAddress& address,
                                                       const std::vector<grpc::Service*>& services,
                                                       monitoring::MetricRegistry& metrics);
  // Shuts down at once, if Shutdown was not called.
  ~Server();

  // Where it listens; the port that was picked if it was 0.
  const security::ListenAddress& address() const { return address_; }

  // Safe from any thread.
  void SetPredictionsReady(bool ready);

  // Everything turns NOT_SERVING, for good. Calls are still answered.
  void TurnHealth();
  // Refuses new calls, lets those in flight end until `deadline`, then cancels them.
  void Shutdown(std::chrono::system_clock::time_point deadline);

 private:
  Server(std::unique_ptr<grpc::Server> server, security::ListenAddress address);

  const security::ListenAddress address_;
  const std::unique_ptr<grpc::Server> server_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_SERVER_H_
