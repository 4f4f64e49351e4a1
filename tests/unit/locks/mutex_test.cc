#include "locks/mutex.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace maneuver::mutex_test {
namespace {

// Returns whether another thread could take the mutex now.
bool IsFree(Mutex& mutex) {
  bool free = false;
  std::jthread([&] {
    if (!mutex.TryLock()) return;
    free = true;
    mutex.Unlock();
  }).join();
  return free;
}

TEST(MutexLockTest, HoldsTheMutexUntilItsEnd) {
  Mutex mutex;
  {
    const MutexLock lock(mutex);
    EXPECT_FALSE(IsFree(mutex));
  }
  EXPECT_TRUE(IsFree(mutex));
}

TEST(MutexLockTest, LetsGoBetweenUnlockAndLock) {
  Mutex mutex;
  {
    MutexLock lock(mutex);
    lock.Unlock();
    EXPECT_TRUE(IsFree(mutex));
    lock.Lock();
    EXPECT_FALSE(IsFree(mutex));
    lock.Unlock();
  }
  EXPECT_TRUE(IsFree(mutex));
}

TEST(CondVarTest, HoldsTheMutexAgainAfterAWait) {
  Mutex mutex;
  CondVar changed;
  bool set = false;
  MutexLock lock(mutex);
  // Takes the mutex, so it goes on once Wait has released it.
  const std::jthread setter([&] {
    const MutexLock setting(mutex);
    set = true;
    changed.NotifyOne();
  });
  while (!set) changed.Wait(mutex);
  EXPECT_FALSE(IsFree(mutex));
}

TEST(CondVarTest, SaysThatTheTimeIsOver) {
  Mutex mutex;
  CondVar changed;
  const MutexLock lock(mutex);
  EXPECT_FALSE(changed.WaitUntil(mutex, std::chrono::steady_clock::time_point::min()));
  EXPECT_FALSE(changed.WaitFor(mutex, std::chrono::nanoseconds(0)));
}

}  // namespace
}  // namespace maneuver::mutex_test
