// A few threads for work that would hold up others: threads of gRPC, above all.

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
  // Work beyond max_waiting is refused, not queued.
  WorkerPool(int threads, size_t max_waiting);
  // Runs what was accepted to its end. Destroy it after everyone who posts.
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // Runs `work` soon, in order of acceptance. False, and `work` is dropped, if too much waits.
  bool Post(std::function<void()> work);
  // The next step of something whose first step was accepted: never refused. Each such thing may
  // have one step waiting.
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
