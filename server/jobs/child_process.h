// Runs a child process that can be asked to stop, and reads its output line by line.

#ifndef MANEUVER_SERVER_JOBS_CHILD_PROCESS_H_
#define MANEUVER_SERVER_JOBS_CHILD_PROCESS_H_

#include <sys/types.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"

namespace maneuver::jobs {

// A request to stop the run of a job. Safe to use from any thread. Each run needs a new one.
class StopRequest {
 public:
  enum class Reason { kNone, kCancelled, kServerStops, kLeaseLost };

  StopRequest();
  ~StopRequest();
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;

  // Asks for a stop. The first reason counts.
  void Stop(Reason reason);
  // Asks for a stop, and kills the process that runs at once, if there is one. Returns whether this
  // is the first call.
  bool Kill(Reason reason);
  // Names the process group that Kill kills; 0: none. Call with 0 before the group's id may become
  // another group's.
  void SetGroup(pid_t group);
  Reason reason() const { return reason_; }
  // Returns a file descriptor that becomes readable once Stop was called; -1 if the system gave
  // none.
  int descriptor() const { return descriptor_; }

 private:
  std::atomic<Reason> reason_ = Reason::kNone;
  int descriptor_;
  Mutex mutex_;
  pid_t group_ ABSL_GUARDED_BY(mutex_) = 0;
  bool kills_ ABSL_GUARDED_BY(mutex_) = false;
};

struct ChildCommand {
  std::vector<std::string> arguments;  // [0] is the program: a path, or a name to look up
  // The file to which standard error is appended.
  std::filesystem::path log;
  // Time from SIGTERM to SIGKILL when the process is stopped.
  std::chrono::milliseconds patience{5'000};
  // The process is stopped after this time; 0: never.
  std::chrono::milliseconds time_limit{0};
  // The process is killed when its memory, and that of the processes that its main thread started,
  // exceeds this many bytes. Counts resident and swapped memory, but not mapped files, and no
  // processes further down; checked about every 200 ms. 0: no limit.
  int64_t memory_limit_bytes = 0;
  // Whether it yields processor and disk to all others: nice 19, SCHED_IDLE, last of the
  // best-effort class. False for a process that a caller waits for.
  bool yields = true;
};

struct ChildResult {
  int exit_status = 0;  // if signal is 0
  int signal = 0;       // the signal that killed the process, or 0
  // It was stopped because time_limit had passed.
  bool timed_out = false;
  // It was killed by SIGKILL while the system was killing processes for lack of memory.
  bool out_of_memory = false;
  // It was killed because it exceeded memory_limit_bytes.
  bool over_memory_limit = false;
};

// Runs a command to its end. The process gets its own process group, no standard input, and SIGKILL
// when the calling thread ends. So call this from a thread that lives as long as the server.
// Processes that remain in its group are killed.
//   on_line: called with each line of standard output, without its end; lines over 1 MiB are
//     dropped.
//   on_tick: called about every 200 ms in between, on the same thread.
// Errors: NOT_FOUND, PERMISSION_DENIED and so on if it cannot be started.
absl::StatusOr<ChildResult> RunChild(const ChildCommand& command, StopRequest& stop,
                                     const std::function<void(const std::string&)>& on_line,
                                     const std::function<void()>& on_tick);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_CHILD_PROCESS_H_
