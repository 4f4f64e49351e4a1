// A mutex whose use clang checks. State that it guards is marked ABSL_GUARDED_BY, and functions
// that need it held are marked ABSL_EXCLUSIVE_LOCKS_REQUIRED. `tests/checks/run.sh locks` runs the
// check.
//
// This wraps the standard library's mutex, which carries no such marks. Abseil's carries them, but
// Debian builds it without ThreadSanitizer, which then reports races where there are none.

#ifndef MANEUVER_LOCKS_MUTEX_H_
#define MANEUVER_LOCKS_MUTEX_H_

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "absl/base/thread_annotations.h"

namespace maneuver {

class ABSL_LOCKABLE Mutex {
 public:
  Mutex() = default;
  Mutex(const Mutex&) = delete;
  Mutex& operator=(const Mutex&) = delete;

  void Lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void Unlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }
  // Returns whether it took the lock. Never waits.
  bool TryLock() ABSL_EXCLUSIVE_TRYLOCK_FUNCTION(true) { return mutex_.try_lock(); }

 private:
  friend class CondVar;
  std::mutex mutex_;
};

// Holds a mutex from its construction to its destruction, except between Unlock and Lock.
class ABSL_SCOPED_LOCKABLE MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_.Lock();
  }
  ~MutexLock() ABSL_UNLOCK_FUNCTION() {
    if (held_) mutex_.Unlock();
  }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

  void Unlock() ABSL_UNLOCK_FUNCTION() {
    mutex_.Unlock();
    held_ = false;
  }
  void Lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() {
    mutex_.Lock();
    held_ = true;
  }

 private:
  Mutex& mutex_;
  bool held_ = true;
};

// Waits for a change of what a mutex guards. Each wait releases the mutex and takes it again. A
// wait may end without a change, so wait in a loop that checks the condition:
//   while (queue_.empty()) changed_.Wait(mutex_);
class CondVar {
 public:
  CondVar() = default;
  CondVar(const CondVar&) = delete;
  CondVar& operator=(const CondVar&) = delete;

  void Wait(Mutex& mutex) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    Borrowed lock(mutex.mutex_);
    changed_.wait(lock);
  }
  // Return false if the time is over.
  template <typename Clock, typename Duration>
  bool WaitUntil(Mutex& mutex, std::chrono::time_point<Clock, Duration> end)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    Borrowed lock(mutex.mutex_);
    return changed_.wait_until(lock, end) == std::cv_status::no_timeout;
  }
  template <typename Rep, typename Period>
  bool WaitFor(Mutex& mutex, std::chrono::duration<Rep, Period> time)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    Borrowed lock(mutex.mutex_);
    return changed_.wait_for(lock, time) == std::cv_status::no_timeout;
  }

  void NotifyOne() { changed_.notify_one(); }
  void NotifyAll() { changed_.notify_all(); }

 private:
  // The caller's lock in the form that the standard library asks for. The caller keeps it.
  struct Borrowed : std::unique_lock<std::mutex> {
    explicit Borrowed(std::mutex& mutex) : std::unique_lock<std::mutex>(mutex, std::adopt_lock) {}
    ~Borrowed() { release(); }
  };

  std::condition_variable changed_;
};

}  // namespace maneuver

#endif  // MANEUVER_LOCKS_MUTEX_H_
