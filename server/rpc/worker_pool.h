// A few threads for work that would block other threads, above all those of gRPC.

#ifndef MANEUVER_SERVER_RPC_WORKER_POOL_H_
#define MANEUVER_SERVER_RPC_WORKER_POOL_H_

#include <cstddef>
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
  WorkerPool(int threads, size_t max_waiting);
  // Finishes all accepted work. Destroy the pool after everyone who posts to it.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // Runs `work` soon, in order of acceptance. Returns false, and drops `work`, if too much is
  // waiting.
  bool Post(std::function<void()> work);
  // Queues the next step of work that Post accepted earlier. Never refuses. A piece of work may
  // have at most one step waiting.
  void Continue(std::function<void()> work);

 private:
  void Run();

  const size_t max_waiting_;
  Mutex mutex_;
  CondVar changed_;
  std::deque<std::function<void()>> waiting_ ABSL_GUARDED_BY(mutex_);
  bool ends_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_WORKER_POOL_H_
