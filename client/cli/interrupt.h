// Turns Ctrl-C into a call on an ordinary thread.

#ifndef MANEUVER_CLIENT_CLI_INTERRUPT_H_
#define MANEUVER_CLIENT_CLI_INTERRUPT_H_

#include <atomic>
#include <functional>
#include <thread>

namespace maneuver::cli {

// While it lives, the first SIGINT calls `on_interrupt` on its own thread, where locks may be
// taken. The second SIGINT ends the program as usual. Only one may exist at a time. Does nothing
// where SIGINT is ignored, as by a shell for what a script starts with &.
class Interrupt {
 public:
  explicit Interrupt(std::function<void()> on_interrupt);
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  bool happened() const { return happened_; }

 private:
  int pipe_[2] = {-1, -1};
  std::atomic<bool> happened_ = false;
  std::thread waiter_;
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_INTERRUPT_H_
