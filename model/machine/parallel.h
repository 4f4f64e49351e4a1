// Runs work on several threads and waits for it.

#ifndef MANEUVER_MODEL_MACHINE_PARALLEL_H_
#define MANEUVER_MODEL_MACHINE_PARALLEL_H_

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <functional>
#include <type_traits>

#include "absl/status/status.h"
#include "locks/mutex.h"

namespace maneuver::machine {

// Calls work(0) .. work(threads - 1), each on a thread of its own, work(0) on the calling one, and
// waits for all. Throws the first exception on that one of them throws. At least one thread works.
void OnThreads(int threads, const std::function<void(int thread)>& work);

// Calls work(0) .. work(count - 1) on at most `threads` threads, the calling one among them, and
// waits for all. Throws on as OnThreads does.
//   work: returns nothing and may throw, or returns an absl::Status and does not throw. After an
//     exception or an error no more items are begun. The first error is returned.
template <typename Work>
std::invoke_result_t<Work, size_t> ForEachOnThreads(size_t count, int threads, const Work& work) {
  const int useful = static_cast<int>(std::min(static_cast<size_t>(std::max(1, threads)), count));
  std::atomic<size_t> next = 0;
  if constexpr (std::is_void_v<std::invoke_result_t<Work, size_t>>) {
    OnThreads(useful, [&](int) {
      for (size_t item = next++; item < count; item = next++) {
        try {
          work(item);
        } catch (...) {
          next = count;
          throw;
        }
      }
    });
  } else {
    Mutex mutex;
    absl::Status first;  // guarded by mutex
    OnThreads(useful, [&](int) {
      for (size_t item = next++; item < count; item = next++) {
        const absl::Status done = work(item);
        if (done.ok()) continue;
        const MutexLock lock(mutex);
        first.Update(done);
        next = count;
      }
    });
    return first;
  }
}

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_PARALLEL_H_
