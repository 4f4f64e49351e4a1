// Cancels calls from another thread.

#ifndef MANEUVER_CLIENT_CANCELLATION_H_
#define MANEUVER_CLIENT_CANCELLATION_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "locks/mutex.h"

namespace maneuver::client {

// Pass one to calls by CallOptions::cancellation. Cancel() ends all calls that are running or start
// later, with CANCELLED. Thread-safe. Must outlive those calls. Must not be used in a signal
// handler.
class Cancellation {
 public:
  void Cancel() {
    const MutexLock lock(mutex_);
    cancelled_ = true;
    for (const auto& [id, cancel] : running_) cancel();
    changed_.NotifyAll();
  }

  bool cancelled() const {
    const MutexLock lock(mutex_);
    return cancelled_;
  }

  // Waits for `duration` or until cancelled. Returns false if cancelled.
  bool Sleep(absl::Duration duration) const {
    const auto end = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(duration);
    const MutexLock lock(mutex_);
    while (!cancelled_ && changed_.WaitUntil(mutex_, end)) {
    }
    return !cancelled_;
  }

  // For as long as it lives, Cancel() calls `cancel`. Calls it at once if already cancelled, and
  // never if `cancellation` is nullptr. `cancel` runs under the lock, so it must not use this
  // Cancellation; the destructor waits until it has returned.
  class Registration {
   public:
    Registration(Cancellation* cancellation, std::function<void()> cancel)
        : cancellation_(cancellation) {
      if (cancellation_ == nullptr) return;
      const MutexLock lock(cancellation_->mutex_);
      if (cancellation_->cancelled_) cancel();
      id_ = cancellation_->next_id_++;
      cancellation_->running_.emplace(id_, std::move(cancel));
    }
    ~Registration() {
      if (cancellation_ == nullptr) return;
      const MutexLock lock(cancellation_->mutex_);
      cancellation_->running_.erase(id_);
    }
    Registration(const Registration&) = delete;
    Registration& operator=(const Registration&) = delete;

   private:
    Cancellation* const cancellation_;
    uint64_t id_ = 0;
  };

 private:
  mutable Mutex mutex_;
  mutable CondVar changed_;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  uint64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint64_t, std::function<void()>> running_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CANCELLATION_H_
