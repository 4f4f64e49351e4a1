#include "client/cli/interrupt.h"

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <utility>

namespace maneuver::cli {
namespace {

std::atomic<int> signal_pipe = -1;

// Only what is allowed in a signal handler: the thread at the other end of the pipe does the rest.
void OnSignal(int) {
  const int fd = signal_pipe.exchange(-1);
  if (fd >= 0) (void)!write(fd, "i", 1);
}

}  // namespace

Interrupt::Interrupt(std::function<void()> on_interrupt) {
  struct sigaction before = {};
  if (sigaction(SIGINT, nullptr, &before) == 0 && before.sa_handler == SIG_IGN) return;
  if (pipe2(pipe_, O_CLOEXEC) != 0) return;  // then SIGINT ends the program as usual
  waiter_ = std::thread([this, on_interrupt = std::move(on_interrupt)] {
    char what = 0;
    if (read(pipe_[0], &what, 1) != 1 || what != 'i') return;
    happened_ = true;
    on_interrupt();
  });
  signal_pipe = pipe_[1];
  struct sigaction action = {};
  action.sa_handler = OnSignal;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigaction(SIGINT, &action, nullptr);
}

Interrupt::~Interrupt() {
  if (!waiter_.joinable()) return;
  std::signal(SIGINT, SIG_DFL);
  signal_pipe = -1;
  (void)!write(pipe_[1], "q", 1);
  waiter_.join();
  close(pipe_[0]);
  close(pipe_[1]);
}

}  // namespace maneuver::cli
