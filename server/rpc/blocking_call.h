// Runs methods that wait for the disk on threads of the pool instead of gRPC's.

#ifndef MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
#define MANEUVER_SERVER_RPC_BLOCKING_CALL_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <cstdint>
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

// Empties the request of a unary call that has its answer. gRPC keeps the message until the caller
// has taken the answer, which may be never.
template <typename Request>
void FreeRequest(const Request* request) {
  Request empty;
  const_cast<Request*>(request)->Swap(&empty);
}

// Answers a unary call with the Status that `work` returns, from a thread of `pool`. Adds a reason
// to failures of the disk that have none. Refuses the call if too much waits.
template <typename Request, typename Work>
grpc::ServerUnaryReactor* AnswerFrom(WorkerPool& pool, grpc::CallbackServerContext* rpc,
                                     const Request* request, Work work) {
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  const auto bytes = static_cast<int64_t>(request->ByteSizeLong());
  const bool accepted = pool.Post(
      [reactor, request, work = std::move(work)] {
        const absl::Status status = errors::WithStorageReason(work());
        FreeRequest(request);
        reactor->Finish(ToGrpcStatus(status));
      },
      bytes);
  if (!accepted) reactor->Finish(ToGrpcStatus(Busy()));
  return reactor;
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
