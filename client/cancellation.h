// Cancels calls from another thread.

#ifndef MANEUVER_CLIENT_CANCELLATION_H_
#define MANEUVER_CLIENT_CANCELLATION_H_

#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>

#include "absl/time/time.h"

namespace maneuver::client {

// Pass one to calls by CallOptions::cancellation. Cancel() ends all calls that are running or start
// later, with CANCELLED. Thread-safe. Must outlive those calls. Must not be used in a signal
// handler.
class Cancellation {
 public:
  void Cancel() {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
    for (const auto& [id, cancel] : running_) cancel();
    changed_.notify_all();
  }

  bool cancelled() const {
    const std::lock_guard lock(mutex_);
    return cancelled_;
  }

  // Waits for `duration` or until cancelled. Returns false if cancelled.
  bool Sleep(absl::Duration duration) const {
    std::unique_lock lock(mutex_);
    return !changed_.wait_for(lock, absl::ToChronoNanoseconds(duration),
                              [this] { return cancelled_; });
  }

  // For as long as it lives, Cancel() calls `cancel`. Calls it at once if already cancelled.
  class Registration {
   public:
    Registration(Cancellation* cancellation, std::function<void()> cancel)
        : cancellation_(cancellation) {
      if (cancellation_ == nullptr) return;
      const std::lock_guard lock(cancellation_->mutex_);
      if (cancellation_->cancelled_) cancel();
      id_ = cancellation_->next_id_++;
      cancellation_->running_.emplace(id_, std::move(cancel));
    }
    ~Registration() {
      if (cancellation_ == nullptr) return;
      const std::lock_guard lock(cancellation_->mutex_);
      cancellation_->running_.erase(id_);
    }
    Registration(const Registration&) = delete;
    Registration& operator=(const Registration&) = delete;

   private:
    Cancellation* const cancellation_;
    int id_ = 0;
  };

 private:
  mutable std::mutex mutex_;  // guards what follows
  mutable std::condition_variable changed_;
  bool cancelled_ = false;
  int next_id_ = 0;
  std::map<int, std::function<void()>> running_;
};

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_CANCELLATION_H_
