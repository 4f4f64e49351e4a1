// A few threads for work that would block other threads, above all those of gRPC.

#ifndef MANEUVER_SERVER_RPC_WORKER_POOL_H_
#define MANEUVER_SERVER_RPC_WORKER_POOL_H_

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::rpc {

// Safe to use from any thread.
class WorkerPool {
 public:
  // Starts the threads. At most `max_waiting` pieces of work wait; more are refused.
  //   max_bytes: most bytes of all work that waits or runs. Work that is alone may have more.
  WorkerPool(int threads, size_t max_waiting, int64_t max_bytes = int64_t{128} << 20);
  // Finishes all accepted work. Destroy the pool after everyone who posts to it.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // Runs `work` soon, in order of acceptance. Returns false, and drops `work`, if too much is
  // waiting.
  //   bytes: what the work keeps in memory until it has run, such as a request
  bool Post(std::function<void()> work, int64_t bytes = 0);
  // Does the same for work that makes room, such as a cancellation: it has twice the limits, so it
  // is accepted when other work is refused.
  bool PostReserved(std::function<void()> work, int64_t bytes = 0);
  // Queues the next step of work that Post accepted earlier. Never refuses. A piece of work may
  // have at most one step waiting.
  void Continue(std::function<void()> work);

 private:
  struct Work {
    std::function<void()> run;
    int64_t bytes = 0;
  };

  bool PostWithin(int limits, std::function<void()> work, int64_t bytes);
  void Run();

  const size_t max_waiting_;
  const int64_t max_bytes_;
  Mutex mutex_;
  CondVar changed_;
  std::deque<Work> waiting_ ABSL_GUARDED_BY(mutex_);
  int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // of work that waits or runs
  bool ends_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_WORKER_POOL_H_
