#include "server/maneuverd/termination.h"

#include <pthread.h>
#include <unistd.h>

#include <thread>

#include "server/monitoring/logging.h"

namespace maneuver {

TerminationSignals::TerminationSignals() {
  sigemptyset(&signals_);
  sigaddset(&signals_, SIGTERM);
  sigaddset(&signals_, SIGINT);
  pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
  // A reader of the log that goes away does not take the server with it.
  signal(SIGPIPE, SIG_IGN);
  signal(SIGCHLD, SIG_DFL);
}

int TerminationSignals::Wait() {
  int signal = 0;
  sigwait(&signals_, &signal);
  return signal;
}

void TerminationSignals::ExitOnNext() {
  std::thread([signals = signals_] {
    int signal = 0;
    sigwait(&signals, &signal);
    _exit(128 + signal);
  }).detach();
}

void ExitAfter(std::chrono::milliseconds time) {
  std::thread([time] {
    std::this_thread::sleep_for(time);
    // The log may hang, too.
    std::thread([] {
      monitoring::Log(monitoring::LogLevel::kError,
                      "work that has not ended is broken off; does the disk or the store hang?");
    }).detach();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    _exit(1);
  }).detach();
}

}  // namespace maneuver
