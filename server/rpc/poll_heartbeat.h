// Keeps gRPC's threads from falling asleep.
//
// The threads that read what comes for the callback API look away for 100 ms whenever none of them
// has had anything for a second (gRPC 1.51, CallbackAlternativeCQ): who calls once a second then
// waits for up to that long. Something that is always there before the second is over keeps them
// looking: a call that ends at once, on a channel that leads nowhere.

#ifndef MANEUVER_SERVER_RPC_POLL_HEARTBEAT_H_
#define MANEUVER_SERVER_RPC_POLL_HEARTBEAT_H_

#include <grpcpp/generic/generic_stub.h>

#include <chrono>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

class PollHeartbeat {
 public:
  // At most a third of the second: there are two such threads and more, and one that has had the
  // last beats is enough.
  explicit PollHeartbeat(std::chrono::milliseconds interval = std::chrono::milliseconds(300));
  PollHeartbeat(const PollHeartbeat&) = delete;
  PollHeartbeat& operator=(const PollHeartbeat&) = delete;
  ~PollHeartbeat();

  // Waits until so many beats have been seen by gRPC's threads.
  void AwaitBeats(int count);
  // When gRPC's threads saw the last beat; at first, when this was made. They are stuck if that is
  // many intervals ago.
  std::chrono::steady_clock::time_point last_beat() const;

 private:
  void Run();

  const std::chrono::milliseconds interval_;
  grpc::GenericStub nowhere_;
  mutable Mutex mutex_;
  CondVar changed_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool under_way_ ABSL_GUARDED_BY(mutex_) = false;
  int beats_ ABSL_GUARDED_BY(mutex_) = 0;
  std::chrono::steady_clock::time_point last_beat_ ABSL_GUARDED_BY(mutex_) =
      std::chrono::steady_clock::now();
  std::thread thread_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_POLL_HEARTBEAT_H_
