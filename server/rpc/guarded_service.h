// A gRPC service behind the access control. Every method, including methods added later, is
// admitted before any of its code runs, even before gRPC receives its request: without a caller who
// may call, at most what fits HTTP/2's first window is held.

#ifndef MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_
#define MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_

#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/rpc/message_gate.h"
#include "server/rpc/small_messages.h"
#include "server/security/access_control.h"

namespace maneuver::rpc {

// A service, with its full name in the contract: "maneuver.v1.PredictionService". The service must
// outlive the server.
struct NamedService {
  const char* name = nullptr;
  grpc::Service* service = nullptr;
  // Refuses calls that are not worth their work: returns an error for a call of a method
  // ("/maneuver.v1.PredictionService/Predict") with this deadline. Called only for unary calls,
  // after the caller is admitted and before the request is parsed: parsing is a good part of the
  // work, and an overloaded server has no time for it. Empty: no call is refused.
  std::function<absl::Status(std::string_view method,
                             std::chrono::system_clock::time_point deadline,
                             const grpc::ByteBuffer& request)>
      check_request = {};
  // If this is an error, every call of a caller who is admitted ends with it, and health says
  // NOT_SERVING.
  absl::Status refusal = {};
  // Refuses calls while the server has no room for what they need: returns an error, or what is kept
  // until the call's single request is parsed. Called for each call but those that stop or remove
  // something: with 0 before its request is received, then with the bytes of a single request.
  // Empty: no call is refused.
  std::function<absl::StatusOr<std::shared_ptr<const void>>(int64_t request_bytes)> reserve_memory =
      {};
  // Bounds how many large requests are received at once, but for calls that stop or remove something.
  // It must outlive the server. Null: the server's own, which lets any number pass.
  MessageGate* message_gate = nullptr;
  // For methods that anybody may call: bounds what their requests bring. It must outlive the server.
  // Null: requests have any size up to gRPC's limit.
  SmallMessages* small_messages = nullptr;
};

// Register it instead of the service that it guards. The generated code has no place for such a
// check, and gRPC's server interceptors cannot keep a handler from running. So this class takes the
// service's handlers and runs them only for admitted calls.
class GuardedService final : public grpc::Service {
 public:
  // Wraps a service. All arguments must outlive the result. INTERNAL if the contract has no such
  // service.
  //   gate: for requests of services without one, and of calls that stop or remove something
  static absl::StatusOr<std::unique_ptr<GuardedService>> Create(const NamedService& guarded,
                                                                security::AccessControl& access,
                                                                MessageGate& gate);

  // Returns the full names of its methods, such as "/maneuver.v1.PredictionService/Predict".
  std::vector<std::string> MethodNames() const;

 private:
  GuardedService() = default;

  std::vector<std::unique_ptr<const std::string>> method_names_;  // gRPC keeps pointers to them
};

// Returns when the caller gives up: time_point::max() if it set no deadline, or one more than a
// hundred days ahead. (gRPC's own conversion turns deadlines centuries ahead into past ones.)
std::chrono::system_clock::time_point DeadlineOf(const grpc::ServerContextBase& rpc);

// Returns the credentials that the caller sent.
security::Credentials CredentialsOf(const grpc::ServerContextBase& rpc);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_GUARDED_SERVICE_H_
