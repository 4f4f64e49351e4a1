// The parts of gRPC's internals that this server uses. gRPC does not guarantee them. So no other
// file names them, and an untested version of gRPC does not compile.

#ifndef MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_
#define MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_

#include <grpcpp/impl/codegen/server_callback_handlers.h>
#include <grpcpp/impl/rpc_service_method.h>
#include <grpcpp/version_info.h>

namespace maneuver::rpc {

// After an update, check that gRPC still calls MethodHandler::Deserialize before RunHandler, in the
// callback API only for methods that take a single request, and hands it the call's byte buffer.
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

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_GRPC_INTERNALS_H_
