// The parts of gRPC's internals that this server uses. gRPC does not guarantee them. So no other
// file names them, and an untested version of gRPC does not compile.

#ifndef MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_
#define MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_

#include <grpc/byte_buffer.h>
#include <grpc/grpc.h>
#include <grpcpp/impl/call.h>
#include <grpcpp/impl/call_op_set.h>
#include <grpcpp/impl/codegen/server_callback_handlers.h>
#include <grpcpp/impl/rpc_service_method.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/callback_common.h>
#include <grpcpp/version_info.h>

#include <cstring>
#include <functional>
#include <string>
#include <utility>

#include "absl/status/status.h"

namespace maneuver::rpc {

// After an update, check that gRPC runs the handler of a BIDI_STREAMING method before it receives a
// message, and that handlers of methods with a single request still take what their Deserialize made
// of the call's byte buffer.
static_assert(GRPC_CPP_VERSION_MAJOR == 1 && GRPC_CPP_VERSION_MINOR == 51,
              "compare server/rpc/grpc_internals.h with this version of gRPC");

// What answers the calls of a method; GuardedService stands before it.
using grpc::internal::MethodHandler;
using grpc::internal::RpcMethod;
using grpc::internal::RpcServiceMethod;

template <typename Request, typename Response>
using UnaryHandler = grpc::internal::CallbackUnaryHandler<Request, Response>;
template <typename Request, typename Response>
using ClientStreamingHandler = grpc::internal::CallbackClientStreamingHandler<Request, Response>;
template <typename Request, typename Response>
using ServerStreamingHandler = grpc::internal::CallbackServerStreamingHandler<Request, Response>;
template <typename Request, typename Response>
using BidiHandler = grpc::internal::CallbackBidiHandler<Request, Response>;

// A reactor whose OnDone runs in the thread in which the call ends, without waking another. For
// reactors whose OnDone is short.
template <typename Reactor>
class InlineReactor : public Reactor {
 private:
  bool InternalInlineable() final { return true; }
};

// A call that can be cancelled even after its end.
class CallHandle {
 public:
  explicit CallHandle(grpc_call* call) : call_(call) { grpc_call_ref(call_); }
  explicit CallHandle(grpc::ServerContextBase& rpc) : CallHandle(rpc.c_call()) {}
  ~CallHandle() { grpc_call_unref(call_); }
  CallHandle(const CallHandle&) = delete;
  CallHandle& operator=(const CallHandle&) = delete;

  // Ends the call with an error, without its details. Safe from any thread.
  void Cancel(const absl::Status& error) {
    grpc_call_cancel_with_status(call_, static_cast<grpc_status_code>(error.code()),
                                 std::string(error.message()).c_str(), nullptr);
  }

  grpc_call* get() const { return call_; }

 private:
  grpc_call* const call_;
};

// Receives one message of a call that was handed over without any.
class MessageReading {
 public:
  explicit MessageReading(grpc_call* call) : call_(call) {}

  // Calls `on_received` once, from any thread and after this returns or meanwhile, with the message,
  // which it takes over, or with nullptr if there is none. What `on_received` holds is let go of
  // afterwards. Call it once.
  void Start(grpc::internal::Call& call, std::function<void(grpc_byte_buffer*)> on_received) {
    on_received_ = std::move(on_received);
    tag_.Set(
        call_.get(),
        [this](bool) {
          const auto done = std::move(on_received_);  // which may hold this object
          done(Take());
        },
        &operation_, /*can_inline=*/true);
    operation_.RecvMessage(&message_);
    operation_.set_core_cq_tag(&tag_);
    call.PerformOps(&operation_);
  }

  // Ends the call with an error, without its details. May be called after Start, or meanwhile.
  void Cancel(const absl::Status& error) { call_.Cancel(error); }

 private:
  grpc_byte_buffer* Take() {
    static_assert(sizeof(grpc::ByteBuffer) == sizeof(grpc_byte_buffer*),
                  "a ByteBuffer is no pointer to a grpc_byte_buffer any more");
    grpc_byte_buffer* bytes = nullptr;
    std::memcpy(&bytes, static_cast<const void*>(&message_), sizeof(grpc::ByteBuffer));
    message_.Release();
    return bytes;
  }

  CallHandle call_;
  std::function<void(grpc_byte_buffer*)> on_received_;
  grpc::ByteBuffer message_;
  grpc::internal::CallOpSet<grpc::internal::CallOpRecvMessage<grpc::ByteBuffer>> operation_;
  grpc::internal::CallbackWithSuccessTag tag_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_
