#include "model/learning/for_each_on_threads.h"

#include <atomic>
#include <thread>
#include <vector>

#include "locks/mutex.h"

namespace maneuver::learning {

absl::Status ForEachOnThreads(size_t count, int threads,
                              const std::function<absl::Status(size_t)>& work) {
  std::atomic<size_t> next = 0;
  Mutex mutex;
  absl::Status first;  // guarded by mutex
  {
    std::vector<std::jthread> workers;
    for (int i = 0; i < threads; ++i) {
      workers.emplace_back([&] {
        for (size_t each = next++; each < count; each = next++) {
          const absl::Status done = work(each);
          if (done.ok()) continue;
          const MutexLock lock(mutex);
          first.Update(done);
          next = count;
        }
      });
    }
  }
  return first;
}

}  // namespace maneuver::learning
