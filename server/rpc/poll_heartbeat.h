// Keeps gRPC's polling threads awake.
//
// The threads that receive messages for the callback API pause for 100 ms whenever none of them has
// received anything for a second (gRPC 1.51, CallbackAlternativeCQ). A client that calls once a
// second then waits up to 100 ms. To prevent the pause, this class makes a call that ends at once,
// on a channel that leads nowhere, several times a second.

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
  // Starts beating. A beat keeps one of the threads awake for a second. That is enough, although
  // the others may pause.
  explicit PollHeartbeat(std::chrono::milliseconds interval = std::chrono::milliseconds(300));
  PollHeartbeat(const PollHeartbeat&) = delete;
  PollHeartbeat& operator=(const PollHeartbeat&) = delete;
  ~PollHeartbeat();

  // Waits until gRPC's threads have seen `count` beats since construction.
  void AwaitBeats(int count);
  // Returns when gRPC's threads saw the last beat; at first, the time of construction. If that is
  // many intervals ago, the threads are stuck.
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
