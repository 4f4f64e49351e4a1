// Bounds how many large requests are being received at once. gRPC receives a message of any size up
// to its limit as soon as it is asked to, and does not tell how much of it has arrived. But a small one
// arrives at once, so the others are known by the time that they take.

#ifndef MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
#define MANEUVER_SERVER_RPC_MESSAGE_GATE_H_

#include <chrono>
#include <cstddef>
#include <list>
#include <memory>
#include <unordered_map>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

// A call whose request has not been received.
class UnreceivedCall {
 public:
  virtual ~UnreceivedCall() = default;
  // Begins to receive the request.
  virtual void Receive() = 0;
  // Stops receiving. Called after, or at the same time as, Receive().
  virtual void Cancel() = 0;
  // Ends the call. Called instead of Receive().
  virtual void Refuse(const absl::Status& status) = 0;
};

// Safe to use from any thread.
class MessageGate {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // A request that takes longer is slow: it is large, or its caller does not send it.
  static constexpr std::chrono::milliseconds kYoung{20};
  // Of too many slow requests, those that take longer than this are cancelled first.
  static constexpr std::chrono::milliseconds kTurn{250};

  //   most_waiting: calls that wait while there are too many slow requests; more are refused
  explicit MessageGate(size_t most_waiting) : most_waiting_(most_waiting) {}

  // Lets `call` receive its request: at once, or after a look that finds no more slow requests than
  // allowed. Refuses it with RESOURCE_EXHAUSTED (MEMORY_FULL) if too many wait.
  void Enter(std::shared_ptr<UnreceivedCall> call, Time now);
  // Call it once for each Receive(), when the request is there or will not come. Returns false if the
  // call was cancelled.
  bool Leave(const UnreceivedCall& call);
  // Returns how many requests are slow.
  size_t CountSlow(Time now);
  // Cancels slow requests until `allowed` are left. Call it often.
  void Look(Time now, size_t allowed);

 private:
  struct Place {
    std::shared_ptr<UnreceivedCall> call;
    Time since;
    bool is_cancelled = false;
  };

  void Receives(std::shared_ptr<UnreceivedCall> call, Time now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t most_waiting_;
  Mutex mutex_;
  bool is_closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::list<Place> receiving_ ABSL_GUARDED_BY(mutex_);  // the first since the longest
  std::unordered_map<const UnreceivedCall*, std::list<Place>::iterator> places_
      ABSL_GUARDED_BY(mutex_);
  std::vector<std::shared_ptr<UnreceivedCall>> waiting_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
