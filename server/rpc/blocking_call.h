// Runs methods that wait for the disk on threads of the pool instead of gRPC's.

#ifndef MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
#define MANEUVER_SERVER_RPC_BLOCKING_CALL_H_

#include <google/protobuf/message.h>
#include <grpcpp/support/server_callback.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <initializer_list>
#include <string_view>
#include <utility>

#include "server/rpc/grpc_internals.h"
#include "server/rpc/status_details.h"
#include "server/rpc/worker_pool.h"
#include "server/serving/send_memory.h"

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

// Empties a message of a unary call that needs it no more. gRPC keeps the message until the caller has
// taken the end of the call, which may be never.
template <typename Message>
void FreeMessage(const Message* message) {
  Message empty;
  const_cast<Message*>(message)->Swap(&empty);
}

template <typename Request>
bool HasOneOfVerbs(std::initializer_list<std::string_view> verbs) {
  const std::string_view method = Request::descriptor()->name();
  return std::ranges::any_of(verbs, [method](auto verb) { return method.starts_with(verb); });
}
// Whether a call stops or removes something. When much waits, it is what helps.
template <typename Request>
bool MakesRoom() {
  return HasOneOfVerbs<Request>({"Cancel", "Delete"});
}
// Whether repeating a call is harmless.
template <typename Request>
bool Reads() {
  return HasOneOfVerbs<Request>({"Get", "List", "Describe", "Query"});
}

// Returns what a message that waits counts as: its bytes on the wire. Messages take up to four times
// as much memory; one full of empty elements, which takes more, counts as a quarter of its memory.
inline int64_t WaitingBytes(const google::protobuf::Message& message) {
  return static_cast<int64_t>(std::max(message.ByteSizeLong(), message.SpaceUsedLong() / 4));
}

// What calls that wait for the disk share. Both must outlive the calls.
struct BlockingWork {
  WorkerPool& pool;
  serving::SendMemory& send_memory;
};

// A unary call whose answer counts as send memory until its caller has taken it. Deletes itself.
class CountedCall final : public InlineReactor<grpc::ServerUnaryReactor> {
 public:
  explicit CountedCall(serving::SendMemory& memory) : memory_(memory) {}

  // Ends the call with the Status that `work` returns, after it has filled `response`. While unread
  // answers fill the memory, refuses the call before its work, unless it makes room. An answer that
  // does not fit is refused only if repeating the call is harmless, so that no caller takes a change
  // that was made for one that was refused.
  template <typename Request, typename Response, typename Work>
  void Answer(const Request* request, const Response* response, const Work& work) {
    absl::Status status = MakesRoom<Request>() ? absl::OkStatus() : memory_.CheckRoom();
    if (status.ok()) status = work();
    FreeMessage(request);
    if (status.ok()) {
      const auto bytes = static_cast<int64_t>(response->ByteSizeLong());
      if (Reads<Request>() || MakesRoom<Request>()) {
        auto share = memory_.TakeIfRoom(bytes);
        status = share.status();
        if (share.ok()) share_ = *std::move(share);
      } else {
        share_ = memory_.Take(bytes);
      }
    }
    if (!status.ok()) FreeMessage(response);
    Finish(ToGrpcStatus(status));
  }

  // Returns whether the caller has given up: it cancelled, its deadline passed, or it is no longer
  // connected.
  bool is_abandoned() const { return is_abandoned_; }

  void OnCancel() override { is_abandoned_ = true; }
  void OnDone() override { delete this; }

 private:
  serving::SendMemory& memory_;
  serving::SendMemory::Share share_;
  std::atomic<bool> is_abandoned_ = false;
};

// Answers a unary call with the Status that `work` returns, from a thread of the pool. Adds a reason
// to failures of the disk that have none. Refuses the call if too much waits, or as CountedCall does;
// ends it without its work if its caller has given up when its turn comes.
template <typename Request, typename Response, typename Work>
grpc::ServerUnaryReactor* AnswerFrom(const BlockingWork& blocking, const Request* request,
                                     const Response* response, Work work) {
  auto* call = new CountedCall(blocking.send_memory);
  auto answer = [call, request, response, work = std::move(work)] {
    if (call->is_abandoned()) return call->Finish(grpc::Status::CANCELLED);
    call->Answer(request, response, [&work] { return errors::WithStorageReason(work()); });
  };
  const int64_t bytes = WaitingBytes(*request);
  const bool accepted = MakesRoom<Request>() ? blocking.pool.PostReserved(std::move(answer), bytes)
                                             : blocking.pool.Post(std::move(answer), bytes);
  if (!accepted) {
    FreeMessage(request);
    call->Finish(ToGrpcStatus(Busy()));
  }
  return call;
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_BLOCKING_CALL_H_
