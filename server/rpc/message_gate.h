// Bounds how many large requests are being received at once, and how long a request takes. gRPC
// receives a message of any size up to its limit as soon as it is asked to, and does not tell how much
// of it has arrived. The system tells what each connection has received. So a request counts as large
// if it takes long, and if the connection that it comes by has brought more than small requests would.

#ifndef MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
#define MANEUVER_SERVER_RPC_MESSAGE_GATE_H_

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <unordered_set>
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
  // Ends the call. Called instead of Receive().
  virtual void Refuse(const absl::Status& status) = 0;
  // Ends the call, which stops receiving. Called after, or at the same time as, Receive().
  virtual void Stop(const absl::Status& status) = 0;
  // Stops receiving even if the caller does not take the end of its call. Called after Stop().
  virtual void Cancel() = 0;
};

// Safe to use from any thread.
class MessageGate {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // A request that takes longer is slow: it is large, or its caller or this machine is.
  static constexpr std::chrono::milliseconds kYoung{20};
  // A connection whose calls have brought more each, on average, has large requests.
  static constexpr int64_t kSmallBytes = int64_t{64} << 10;
  // Of too many large requests, those that take longer than this are stopped first.
  static constexpr std::chrono::milliseconds kTurn{250};

  //   most_waiting: calls that wait while there are too many large requests; more are refused
  explicit MessageGate(size_t most_waiting) : most_waiting_(most_waiting) {}

  // Lets `call` receive its request: at once, or, if its connection has brought large ones, after a
  // look that finds no more of them than allowed. Refuses it with RESOURCE_EXHAUSTED (MEMORY_FULL) if too
  // many wait.
  //   peer: of the call's connection, such as "ipv4:127.0.0.1:4567"
  void Enter(std::shared_ptr<UnreceivedCall> call, std::string peer, Time now);
  // Call it once for each Receive(), when the request is there or will not come. Returns false if the
  // call was stopped.
  bool Leave(const UnreceivedCall& call);
  // Returns whether a request is slow, or a call waits.
  bool HasSlow(Time now);
  // Tells what each connection has received in the last one to two seconds. Until it is told for the
  // first time, every connection counts as one with large requests.
  void Weigh(const std::map<std::string, int64_t>& received);
  // Returns how many slow requests come by connections that have large ones, as weighed last.
  size_t CountLarge(Time now);
  // Stops large requests until `allowed` are left. Call it often.
  void StopExcess(Time now, size_t allowed);
  // Stops requests, of any size, that have taken longer than `longest`. Call it now and then.
  void StopLate(Time now, std::chrono::milliseconds longest);

 private:
  struct Call {
    std::shared_ptr<UnreceivedCall> call;
    std::string peer;
  };
  struct Place : Call {
    Time since;
    std::optional<Time> stopped = std::nullopt;
    bool is_cancelled = false;
  };
  using Places = std::list<Place>;
  using Calls = std::vector<std::shared_ptr<UnreceivedCall>>;

  // Adds the call to those that its caller has to stop: at first, and, if gRPC has not let go of its
  // request a turn later, to those that its caller has to cancel.
  static void Stop(Place& place, Time now, Calls& stopped, Calls& cancelled);
  void Receives(Call call, Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool HasLarge(const std::string& peer) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return !is_weighed_ || with_large_.contains(peer);
  }
  // In the order in which they began.
  std::vector<Places::iterator> FindLarge(Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const size_t most_waiting_;
  Mutex mutex_;
  bool is_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_weighed_ ABSL_GUARDED_BY(mutex_) = false;
  // Calls by connection, of this second and the one before.
  std::unordered_map<std::string, int64_t> entered_ ABSL_GUARDED_BY(mutex_);
  std::unordered_map<std::string, int64_t> entered_before_ ABSL_GUARDED_BY(mutex_);
  // When this second began.
  Time second_ ABSL_GUARDED_BY(mutex_){};
  std::unordered_set<std::string> with_large_ ABSL_GUARDED_BY(mutex_);  // connections
  Places receiving_ ABSL_GUARDED_BY(mutex_);  // the first since the longest
  std::unordered_map<const UnreceivedCall*, Places::iterator> places_ ABSL_GUARDED_BY(mutex_);
  std::vector<Call> waiting_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_MESSAGE_GATE_H_
