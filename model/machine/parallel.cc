#include "model/machine/parallel.h"

#include <exception>
#include <thread>
#include <vector>

namespace maneuver::machine {

void OnThreads(int threads, const std::function<void(int)>& work) {
  Mutex mutex;
  std::exception_ptr first;  // guarded by mutex
  const auto run = [&](int thread) {
    try {
      work(thread);
    } catch (...) {
      const MutexLock lock(mutex);
      if (!first) first = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> others;
    for (int i = 1; i < threads; ++i) others.emplace_back(run, i);
    run(0);
  }
  if (first) std::rethrow_exception(first);
}

}  // namespace maneuver::machine
