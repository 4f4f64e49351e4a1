// Work that several threads do ahead of the one who needs it, and that is handed out in order.

#ifndef MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_
#define MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_

#include <cstddef>
#include <map>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::machine {

// The results of items 0 .. count-1. Threads of the owner claim items and put their results; one
// thread takes them. Thread-safe.
template <typename Result>
class OrderedWork {
 public:
  //   most_ahead: how many items may be claimed whose results have not been taken; at least 1.
  OrderedWork(size_t count, size_t most_ahead) : count_(count), most_ahead_(most_ahead) {}
  OrderedWork(const OrderedWork&) = delete;
  OrderedWork& operator=(const OrderedWork&) = delete;

  // Returns the next item to work on. Waits while too many are ahead. Returns nothing once all are
  // claimed, and after Stop.
  std::optional<size_t> Claim() ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    while (!stopped_ && claimed_ < count_ && claimed_ >= taken_ + most_ahead_) {
      changed_.Wait(mutex_);
    }
    if (stopped_ || claimed_ == count_) return std::nullopt;
    return claimed_++;
  }

  // Hands in the result of an item that was claimed.
  void Put(size_t item, Result result) ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      finished_.emplace(item, std::move(result));
    }
    changed_.NotifyAll();
  }

  // Returns the next result, for which it waits; nothing after the last.
  std::optional<Result> Take() ABSL_LOCKS_EXCLUDED(mutex_) {
    std::optional<Result> result;
    {
      const MutexLock lock(mutex_);
      if (taken_ == count_) return std::nullopt;
      while (!finished_.contains(taken_)) changed_.Wait(mutex_);
      result = std::move(finished_.extract(taken_).mapped());
      ++taken_;
    }
    changed_.NotifyAll();
    return result;
  }

  // Returns whether Take would not wait now. For the thread that takes.
  bool IsReady() ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    return taken_ == count_ || finished_.contains(taken_);
  }

  // Makes Claim return nothing from now on, so that the threads end.
  void Stop() ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      stopped_ = true;
    }
    changed_.NotifyAll();
  }

 private:
  const size_t count_;
  const size_t most_ahead_;
  Mutex mutex_;
  CondVar changed_;
  size_t claimed_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<size_t, Result> finished_ ABSL_GUARDED_BY(mutex_);  // by item
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_
