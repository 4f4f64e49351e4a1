// A gRPC service behind the access control: every method, also one that is declared tomorrow, is
// admitted before anything of it runs, even before its request is parsed.

#ifndef MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_
#define MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_

#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// A service, with its full name in the contract: "maneuver.v1.PredictionService". The service
// outlives the server.
struct NamedService {
  const char* name;
  grpc::Service* service;
  // Whether a call of a method ("/maneuver.v1.PredictionService/Predict") that has until `deadline`
  // for `request` is worth its work. Unary calls alone are asked about, after their callers are
  // admitted and before their requests are parsed: that is a good part of the work, and a server
  // with too much to do has no time for it. Empty: each is.
  std::function<absl::Status(std::string_view method,
                             std::chrono::system_clock::time_point deadline,
                             const grpc::ByteBuffer& request)>
      worth = {};
};

// Registered in place of the service that it guards. The generated code has no place for such a
// check, and gRPC's server interceptors cannot keep a handler from running: so this takes the
// service's handlers, and runs them only for calls that are admitted.
class GuardedService final : public grpc::Service {
 public:
  // Both outlive it. INTERNAL if the contract has no such service.
  static absl::StatusOr<std::unique_ptr<GuardedService>> Create(const NamedService& guarded,
                                                                security::AccessControl& access);

  // "/maneuver.v1.PredictionService/Predict" of each.
  std::vector<std::string> MethodNames() const;

 private:
  GuardedService() = default;

  std::vector<std::unique_ptr<const std::string>> method_names_;  // gRPC keeps pointers to them
};

// When the caller gives up; time_point::max() for no deadline, and for one that is further than a
// hundred days away. gRPC's own conversion takes deadlines in centuries for ones in the past.
std::chrono::system_clock::time_point DeadlineOf(const grpc::ServerContextBase& rpc);

// What a call shows of its caller.
security::Credentials CredentialsOf(const grpc::ServerContextBase& rpc);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_
