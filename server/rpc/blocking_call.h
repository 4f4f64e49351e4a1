// Runs methods that wait for the disk on threads of the pool instead of gRPC's.

#ifndef MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
#define MANEUVER_SERVER_RPC_BLOCKING_CALL_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <utility>

#include "server/rpc/status_details.h"
#include "server/rpc/worker_pool.h"

namespace maneuver::rpc {

// Returns the error of a call that is refused because too many requests wait for the disk.
inline absl::Status Busy() {
  return errors::WithRetryDelay(
      errors::WithReason(
          absl::ResourceExhaustedError(
              "too many requests wait for the server's disk; try again a little later"),
          "TOO_MANY_REQUESTS"),
      std::chrono::seconds(1));
}

// Answers a unary call with the Status that `work` returns, from a thread of `pool`. Adds a reason
// to failures of the disk that have none.
template <typename Work>
grpc::ServerUnaryReactor* AnswerFrom(WorkerPool& pool, grpc::CallbackServerContext* rpc,
                                     Work work) {
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  const bool accepted = pool.Post([reactor, work = std::move(work)] {
    reactor->Finish(ToGrpcStatus(errors::WithStorageReason(work())));
  });
  if (!accepted) reactor->Finish(ToGrpcStatus(Busy()));
  return reactor;
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
