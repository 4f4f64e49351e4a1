// The streams that are open, so that a server that stops need not wait for their callers.

#ifndef MANEUVER_SERVER_RPC_OPEN_STREAMS_H_
#define MANEUVER_SERVER_RPC_OPEN_STREAMS_H_

#include <memory>
#include <set>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

class OpenStream {
 public:
  virtual ~OpenStream() = default;
  // Accepts no more requests, answers those in flight, and ends the stream with ShuttingDown().
  virtual void Drain() = 0;
};

// UNAVAILABLE, reason SHUTTING_DOWN: the caller should open another stream elsewhere.
absl::Status ShuttingDown();

// Safe to use from any thread.
class OpenStreams {
 public:
  // Drains every open stream, and makes Add return false from now on.
  void Drain();

  // Keeps a stream until Remove. Returns false if the stream must end at once.
  bool Add(const std::shared_ptr<OpenStream>& stream);
  void Remove(const std::shared_ptr<OpenStream>& stream);

 private:
  Mutex mutex_;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
  std::set<std::shared_ptr<OpenStream>> streams_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OPEN_STREAMS_H_
