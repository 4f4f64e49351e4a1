// Keeps freed memory while the server is busy, and returns it to the system afterwards.

#ifndef MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_
#define MANEUVER_SERVER_MANEUVERD_IDLE_MEMORY_H_

#include <thread>

#include "locks/stop_latch.h"

namespace maneuver {

// By default, glibc returns memory that is freed at the end of a heap to the system, and fetches it
// again page by page for the next message. That takes a tenth of an overloaded server's time. It
// keeps memory that is freed elsewhere for ever: hundreds of megabytes after a burst of large
// messages. Once an IdleMemory exists, glibc keeps freed blocks of up to 32 MiB, and up to 16 MiB
// at the end of each heap. The thread of IdleMemory checks every two seconds. It returns the memory
// to the system if 32 MiB more than necessary were unused twice in a row.
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
