// Memory that was freed and is not used again goes back to the system.

#ifndef MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_
#define MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_

#include <condition_variable>
#include <mutex>
#include <thread>

namespace maneuver {

// glibc keeps what was freed for the next one who asks: after a burst of large messages that is
// hundreds of megabytes, for good. While this lives, a thread of its own looks every two seconds,
// and gives back what lay idle between two looks, if it is much.
class IdleMemory {
 public:
  IdleMemory();
  ~IdleMemory();
  IdleMemory(const IdleMemory&) = delete;
  IdleMemory& operator=(const IdleMemory&) = delete;

 private:
  void Run();

  std::mutex mutex_;  // guards stopped_
  std::condition_variable stop_;
  bool stopped_ = false;
  std::thread thread_;
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_
