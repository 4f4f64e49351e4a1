// Time and waiting. Tests replace it.

#ifndef MANEUVER_CLIENT_LOAD_TIMELINE_H_
#define MANEUVER_CLIENT_LOAD_TIMELINE_H_

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>

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
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, until, condition);
  }
  void Wake() override {
    const std::lock_guard lock(mutex_);
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
};

}  // namespace maneuver::load

#endif  // MANEUVER_CLIENT_LOAD_TIMELINE_H_
