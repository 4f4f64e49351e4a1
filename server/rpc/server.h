// The gRPC server: guarded services, health, reflection and call metrics on one port.

#ifndef MANEUVER_SERVER_RPC_SERVER_H_
#define MANEUVER_SERVER_RPC_SERVER_H_

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "locks/stop_latch.h"
#include "server/monitoring/metrics.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/poll_heartbeat.h"
#include "server/security/access_control.h"
#include "server/security/listen_address.h"

namespace grpc {
class Server;
class ServerCredentials;
}  // namespace grpc

namespace maneuver::rpc {

class HealthService;
class MessageGate;
class OpenCalls;
class ReflectionService;
class SmallMessages;

// Limits of connections and messages.
struct ConnectionLimits {
  int max_message_bytes = 64 << 20;
  int max_connections = 4096;  // the newest of more are closed, before any authentication
  // Calls at once on one connection; more wait for their turn. A peer that ignores this is cut
  // off once it has had more than twice as many for two seconds.
  int max_streams = 256;
  std::chrono::seconds max_idle{900};  // without a call; then the client has to connect again
  // A connection this old accepts no more calls. Its calls in progress continue, and the client
  // connects anew, perhaps to another replica, and with the current certificates.
  std::chrono::seconds max_age{3600};
  std::chrono::seconds handshake{10};  // from connecting to the client's first frame of HTTP/2
  // A connection that sends nothing for this long is pinged. If no reply comes within a third of
  // this time, it is closed, even with calls in progress.
  std::chrono::seconds keepalive{60};
  // A single request may take this long to arrive. Messages of streams may take any time.
  std::chrono::seconds request{300};
  // The most bytes of incomplete messages that all connections together may hold. gRPC checks a
  // message's size only once all of it has arrived. Above the limit, idle connections are closed.
  // If that is not enough, calls of any caller end with RESOURCE_EXHAUSTED until there is room.
  int64_t max_receive_bytes = int64_t{1} << 30;
};

class Server {
 public:
  // Listens and answers. At first every service, and the server as a whole (""), is SERVING, except
  // PredictionService, which is NOT_SERVING until SetPredictionsReady, and services with a refusal,
  // which stay NOT_SERVING.
  //   services: must outlive the server, as must `access`, which admits their calls.
  //   credentials: nullptr for plain text.
  // UNAVAILABLE if it cannot listen there; INTERNAL if the contract lacks one of the services.
  static absl::StatusOr<std::unique_ptr<Server>> Start(
      const security::ListenAddress& address, const std::vector<NamedService>& services,
      security::AccessControl& access, monitoring::MetricRegistry& metrics,
      std::shared_ptr<grpc::ServerCredentials> credentials = nullptr,
      const ConnectionLimits& limits = {});
  // Shuts down at once, unless Shutdown was called.
  ~Server();

  // Returns the address that it listens on, with the port that was chosen if it was 0.
  const security::ListenAddress& address() const { return address_; }

  // Sets whether PredictionService is SERVING. Safe from any thread.
  void SetPredictionsReady(bool ready);

  // Makes every service NOT_SERVING permanently. Calls are still answered.
  void ShowNotServing();

  // Returns whether a service, or the server as a whole (""), is SERVING according to
  // grpc.health.v1; nothing for any other name. Safe from any thread.
  std::optional<bool> IsServing(std::string_view service) const;
  // Returns whether gRPC's threads have been active lately. If not, no call is answered. Safe from
  // any thread.
  bool IsAlive() const;

  // Refuses new calls, lets calls in flight run until `deadline`, then cancels them. Half a second
  // later it cuts off the connections that are left: a caller that does not read would delay the
  // end.
  void Shutdown(std::chrono::system_clock::time_point deadline);

 private:
  // Keeps the limits that gRPC does not have.
  void KeepLimits(const ConnectionLimits& limits, monitoring::MetricRegistry& metrics,
                  std::set<MessageGate*> gates);

  Server(std::unique_ptr<grpc::Server> server, security::ListenAddress address,
         bool refuses_predictions, std::unique_ptr<MessageGate> gate,
         std::unique_ptr<OpenCalls> calls, std::unique_ptr<SmallMessages> small,
         std::unique_ptr<HealthService> health,
         std::vector<std::unique_ptr<GuardedService>> services,
         std::unique_ptr<ReflectionService> reflection,
         std::shared_ptr<grpc::ServerCredentials> credentials);

  const security::ListenAddress address_;
  const bool refuses_predictions_;
  // gRPC's server uses these until it ends.
  const std::unique_ptr<MessageGate> gate_;
  const std::unique_ptr<OpenCalls> calls_;
  const std::unique_ptr<SmallMessages> small_;
  const std::unique_ptr<HealthService> health_;
  const std::vector<std::unique_ptr<GuardedService>> services_;
  const std::unique_ptr<ReflectionService> reflection_;
  const std::shared_ptr<grpc::ServerCredentials> credentials_;
  const std::unique_ptr<grpc::Server> server_;
  const PollHeartbeat heartbeat_;
  StopLatch stop_;
  std::thread limiter_;  // of connections
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_SERVER_H_
