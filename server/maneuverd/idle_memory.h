// Memory that was freed is kept while there is much to do, and goes back to the system afterwards.

#ifndef MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_
#define MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_

#include <thread>

#include "locks/stop_latch.h"

namespace maneuver {

// By default glibc gives back what is freed at the end of a heap, and fetches it again page by page
// for the next message: a tenth of the time of a server with too much to do. What is freed
// elsewhere it keeps for good: after a burst of large messages, hundreds of megabytes. From the
// first of these on all is kept, but a thread of its own looks every two seconds, and gives back
// what lay idle between two looks, if it is much.
class IdleMemory {
 public:
  IdleMemory();
  ~IdleMemory();
  IdleMemory(const IdleMemory&) = delete;
  IdleMemory& operator=(const IdleMemory&) = delete;

 private:
  void Run();

  StopLatch stop_;
  std::thread thread_;
};

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_
