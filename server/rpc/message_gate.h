// Bounds how many requests are being received at once. gRPC receives a message of any size up to its
// limit as soon as it is asked to, and does not tell how much of it has arrived. So the memory of
// incomplete messages is bounded by asking for few of them at a time.

#ifndef MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
#define MANEUVER_SERVER_RPC_MESSAGE_GATE_H_

#include <chrono>
#include <cstddef>
#include <deque>
#include <list>
#include <memory>

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

// Calls take turns in the order in which they came. Safe to use from any thread.
class MessageGate {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // A request that takes longer is cancelled if another call waits for its place.
  static constexpr std::chrono::milliseconds kTurn{250};
  // A call that waits longer is refused.
  static constexpr std::chrono::seconds kLongestWait{5};

  //   most: requests that are received at once
  //   most_waiting: further calls that wait for a place; more are refused
  MessageGate(size_t most, size_t most_waiting) : most_(most), most_waiting_(most_waiting) {}

  // Lets `call` receive its request, now or as soon as there is a place. Refuses it with
  // RESOURCE_EXHAUSTED (MEMORY_FULL) if too many wait, or once it has waited too long.
  void Enter(std::shared_ptr<UnreceivedCall> call, Time now);
  // Frees the place of a call that has received its request, or will not. Returns false if the call
  // was cancelled. Call it once for each Receive().
  bool Leave(const UnreceivedCall& call, Time now);
  // Cancels and refuses what takes too long. Call it often.
  void Look(Time now);

 private:
  struct Place {
    std::shared_ptr<UnreceivedCall> call;
    Time since;
    bool is_cancelled = false;
  };

  const size_t most_;
  const size_t most_waiting_;
  Mutex mutex_;
  std::list<Place> receiving_ ABSL_GUARDED_BY(mutex_);  // the first since the longest
  std::deque<Place> waiting_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
