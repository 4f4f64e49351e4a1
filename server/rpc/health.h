// grpc.health.v1: tells balancers, probes and clients which services may be called.

#ifndef MANEUVER_SERVER_RPC_HEALTH_H_
#define MANEUVER_SERVER_RPC_HEALTH_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "absl/base/thread_annotations.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

// Safe to use from any thread. It must outlive the server.
class HealthService final : public grpc::health::v1::Health::CallbackService {
 public:
  // Sets whether a service is SERVING; "" is the server as a whole. Services that were never set are
  // unknown. After ShowNotServing it changes no answer.
  void Set(std::string_view service, bool is_serving);
  // Makes every service NOT_SERVING permanently.
  void ShowNotServing();
  // Returns whether a service is SERVING; nothing if it is unknown.
  std::optional<bool> IsServing(std::string_view service) const;

  grpc::ServerUnaryReactor* Check(grpc::CallbackServerContext* rpc,
                                  const grpc::health::v1::HealthCheckRequest* request,
                                  grpc::health::v1::HealthCheckResponse* response) override;
  grpc::ServerWriteReactor<grpc::health::v1::HealthCheckResponse>* Watch(
      grpc::CallbackServerContext* rpc,
      const grpc::health::v1::HealthCheckRequest* request) override;

 private:
  class WatchCall;

  std::optional<bool> Find(std::string_view service) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void TellWatchers() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable Mutex mutex_;
  bool is_turned_ ABSL_GUARDED_BY(mutex_) = false;
  std::map<std::string, bool, std::less<>> serving_ ABSL_GUARDED_BY(mutex_);
  std::set<WatchCall*> watchers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_HEALTH_H_
