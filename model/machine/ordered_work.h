// Lets several threads work ahead of a thread that takes their results in order.

#ifndef MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_
#define MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_

#include <cstddef>
#include <exception>
#include <map>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::machine {

// Results of items 0 .. count-1. The threads that Start begins call Claim and Put; one thread calls
// Take. Thread-safe.
template <typename Result>
class OrderedWork {
 public:
  //   most_ahead: the most claimed items whose results have not been taken; at least 1
  OrderedWork(size_t count, size_t most_ahead) : count_(count), most_ahead_(most_ahead) {}
  // Makes Claim return nothing, and waits for the threads.
  ~OrderedWork() { Stop(nullptr); }
  OrderedWork(const OrderedWork&) = delete;
  OrderedWork& operator=(const OrderedWork&) = delete;

  // Begins a thread that calls work(), which claims items and puts their results until there are
  // none to claim. If it throws, Take throws that on, and the other threads claim no more.
  template <typename Work>
  void Start(Work work) {
    threads_.emplace_back([this, work = std::move(work)] {
      try {
        work();
      } catch (...) {
        Stop(std::current_exception());
      }
    });
  }

  // Returns the next item to work on. Waits while `most_ahead` results have not been taken. Returns
  // nothing once all items are claimed, or a thread failed, or this is being destroyed.
  std::optional<size_t> Claim() ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    while (!stopped_ && claimed_ < count_ && claimed_ >= taken_ + most_ahead_) {
      changed_.Wait(mutex_);
    }
    if (stopped_ || claimed_ == count_) return std::nullopt;
    return claimed_++;
  }

  // Stores the result of a claimed item.
  void Put(size_t item, Result result) ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      finished_.emplace(item, std::move(result));
    }
    changed_.NotifyAll();
  }

  // Waits for the next result and returns it. Returns nothing after the last. Throws what a thread
  // threw, even if the next result is there.
  std::optional<Result> Take() ABSL_LOCKS_EXCLUDED(mutex_) {
    std::optional<Result> result;
    {
      const MutexLock lock(mutex_);
      if (taken_ == count_) return std::nullopt;
      while (!error_ && !finished_.contains(taken_)) changed_.Wait(mutex_);
      if (error_) std::rethrow_exception(error_);
      result = std::move(finished_.extract(taken_).mapped());
      ++taken_;
    }
    changed_.NotifyAll();
    return result;
  }

  // Returns whether Take would return at once. Only the thread that calls Take may call it.
  bool IsReady() ABSL_LOCKS_EXCLUDED(mutex_) {
    const MutexLock lock(mutex_);
    return taken_ == count_ || error_ || finished_.contains(taken_);
  }

 private:
  //   error: what a thread threw, or nullptr
  void Stop(const std::exception_ptr& error) ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const MutexLock lock(mutex_);
      stopped_ = true;
      if (!error_) error_ = error;
    }
    changed_.NotifyAll();
  }

  const size_t count_;
  const size_t most_ahead_;
  Mutex mutex_;
  CondVar changed_;
  size_t claimed_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<size_t, Result> finished_ ABSL_GUARDED_BY(mutex_);  // by item
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::exception_ptr error_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::jthread> threads_;  // last: they end before what they use
};

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_ORDERED_WORK_H_
