// Time and waiting. Tests replace it.

#ifndef MANEUVER_CLIENT_LOAD_TIMELINE_H_
#define MANEUVER_CLIENT_LOAD_TIMELINE_H_

#include <chrono>
#include <functional>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::load {

using TimePoint = std::chrono::steady_clock::time_point;

class Timeline {
 public:
  virtual ~Timeline() = default;

  virtual TimePoint Now() = 0;
  // Returns at `until`, or earlier once `condition` holds. Checks it first, and after each Wake().
  virtual void Wait(TimePoint until, const std::function<bool()>& condition) = 0;
  // Makes Wait() check its condition again. Safe from any thread.
  virtual void Wake() = 0;
};

// Real time. Thread-safe.
class RealTimeline final : public Timeline {
 public:
  TimePoint Now() override { return std::chrono::steady_clock::now(); }
  void Wait(TimePoint until, const std::function<bool()>& condition) override {
    const MutexLock lock(mutex_);
    while (!condition() && changed_.WaitUntil(mutex_, until)) {
    }
  }
  void Wake() override {
    const MutexLock lock(mutex_);
    changed_.NotifyAll();
  }

 private:
  Mutex mutex_;
  CondVar changed_;
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_TIMELINE_H_
