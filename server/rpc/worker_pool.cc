#include "server/rpc/worker_pool.h"

#include <optional>
#include <utility>

namespace maneuver::rpc {

WorkerPool::WorkerPool(int threads, size_t max_waiting, int64_t max_bytes)
    : max_waiting_(max_waiting), max_bytes_(max_bytes) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { Run(); });
}

WorkerPool::~WorkerPool() {
  {
    const MutexLock lock(mutex_);
    ends_ = true;
  }
  changed_.NotifyAll();
  for (std::thread& thread : threads_) thread.join();
}

bool WorkerPool::Post(std::function<void()> work, int64_t bytes) {
  return PostWithin(1, std::move(work), bytes);
}

bool WorkerPool::PostReserved(std::function<void()> work, int64_t bytes) {
  return PostWithin(2, std::move(work), bytes);
}

bool WorkerPool::PostWithin(int limits, std::function<void()> work, int64_t bytes) {
  {
    const MutexLock lock(mutex_);
    if (waiting_.size() >= static_cast<size_t>(limits) * max_waiting_) return false;
    if (bytes > 0 && bytes_ > 0 && bytes_ + bytes > limits * max_bytes_) return false;
    bytes_ += bytes;
    waiting_.push_back({std::move(work), bytes});
  }
  changed_.NotifyOne();
  return true;
}

void WorkerPool::Continue(std::function<void()> work) {
  {
    const MutexLock lock(mutex_);
    waiting_.push_back({std::move(work), 0});
  }
  changed_.NotifyOne();
}

void WorkerPool::Run() {
  MutexLock lock(mutex_);
  for (;;) {
    while (!ends_ && waiting_.empty()) changed_.Wait(mutex_);
    if (waiting_.empty()) return;
    std::optional<Work> work = std::move(waiting_.front());
    const int64_t bytes = work->bytes;
    waiting_.pop_front();
    lock.Unlock();
    work->run();
    work.reset();  // frees what it holds while nobody waits for the lock
    lock.Lock();
    bytes_ -= bytes;
  }
}

}  // namespace maneuver::rpc
