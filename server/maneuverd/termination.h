// How the process of a server ends.

#ifndef MANEUVER_SERVER_MANEUVERD_TERMINATION_H_
#define MANEUVER_SERVER_MANEUVERD_TERMINATION_H_

#include <signal.h>

#include <chrono>

namespace maneuver {

// SIGTERM and SIGINT, as something to wait for.
class TerminationSignals {
 public:
  // Call before any thread is started: threads inherit that these signals are not for them. Also
  // ignores SIGPIPE, and takes SIGCHLD back if the parent process ignored it: otherwise the kernel
  // reaps trainers, and the server cannot learn how they ended.
  TerminationSignals();

  // Waits for the next signal, and returns it.
  int Wait();
  // The next signal ends the process at once.
  void ExitOnNext();

 private:
  sigset_t signals_;
};

// Ends the process after `time`, if it is still there. A disk or a store that hangs does not hold up
// the end; what waits for it is lost as in a crash, and nobody was told that it is done.
void ExitAfter(std::chrono::milliseconds time);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_TERMINATION_H_
