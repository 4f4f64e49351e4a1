// Ends a thread that works at intervals.

#ifndef MANEUVER_LOCKS_STOP_LATCH_H_
#define MANEUVER_LOCKS_STOP_LATCH_H_

#include <chrono>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver {

// Thread-safe.
//   while (!stop_.StoppedWithin(interval)) Work();
class StopLatch {
 public:
  // Ends all waits, now and later.
  void Stop() ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      stopped_ = true;
    }
    changed_.NotifyAll();
  }

  // Ends the present wait, or else the next one, before its time. For a latch on which one thread
  // waits.
  void Wake() ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      woken_ = true;
    }
    changed_.NotifyAll();
  }

  // Waits for `time` or until Stop or Wake. Returns whether Stop was called.
  bool StoppedWithin(std::chrono::nanoseconds time) ABSL_LOCKS_EXCLUDED(mutex_) {
    const auto end = std::chrono::steady_clock::now() + time;
    const MutexLock lock(mutex_);
    while (!stopped_ && !woken_ && changed_.WaitUntil(mutex_, end)) {
    }
    woken_ = false;
    return stopped_;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  bool woken_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace maneuver

#endif  // MANEUVER_LOCKS_STOP_LATCH_H_
