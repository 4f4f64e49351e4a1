#include "server/jobs/child_process.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "model/files/errno_status.h"

namespace maneuver::jobs {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr int kNiceness = 19;
// ioprio_set(2)'s numbers: the last level of the class best-effort, for one process. Debian's
// <linux/ioprio.h> has not been C++ since 6.1.192: a parameter is called `class` in it.
constexpr int kIoWhoProcess = 1;
constexpr int kIoBestEffort = 2;
constexpr int kIoClassShift = 13;
constexpr int kIoLastLevel = 7;
constexpr size_t kMaxLine = size_t{1} << 20;
constexpr int kPipeBytes = 64 * 1024;  // what a pipe usually holds
constexpr milliseconds kTick{200};
// While there is nothing left to read but the process has not ended.
constexpr milliseconds kClosedTick{5};

class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  ~Descriptor() { Close(); }
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  void Close() {
    if (value_ >= 0) close(std::exchange(value_, -1));
  }
  int get() const { return value_; }

 private:
  int value_;
};

struct Pipe {
  Descriptor read;
  Descriptor write;
};

absl::StatusOr<Pipe> MakePipe() {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return files::ErrnoStatus(errno, "open", "a pipe");
  return Pipe{Descriptor(ends[0]), Descriptor(ends[1])};
}

// Between fork and exec: nothing but system calls, since other threads may hold any lock.
[[noreturn]] void BecomeChild(char* const* arguments, bool yields, pid_t parent, int input,
                              int output, int errors, int report) {
  const auto fail = [report] {
    const int reason = errno;
    [[maybe_unused]] const ssize_t ignored = write(report, &reason, sizeof reason);
    _exit(127);
  };
  setpgid(0, 0);
  if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) fail();
  if (getppid() != parent) _exit(127);  // it died before the line above
  if (yields) {
    setpriority(PRIO_PROCESS, 0, kNiceness);
    // Whoever wakes on its core goes at once.
    const sched_param idle{};
    sched_setscheduler(0, SCHED_IDLE, &idle);
    syscall(SYS_ioprio_set, kIoWhoProcess, 0, kIoBestEffort << kIoClassShift | kIoLastLevel);
  }
  // Memory is short: rather this process than the server.
  const int score = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
  if (score >= 0) {
    [[maybe_unused]] const ssize_t ignored = write(score, "500", 3);
    close(score);
  }
  struct sigaction by_default {};
  by_default.sa_handler = SIG_DFL;
  for (const int signal : {SIGPIPE, SIGTERM, SIGINT, SIGHUP, SIGCHLD, SIGUSR1, SIGUSR2}) {
    sigaction(signal, &by_default, nullptr);
  }
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (dup2(input, STDIN_FILENO) < 0 || dup2(output, STDOUT_FILENO) < 0 ||
      dup2(errors, STDERR_FILENO) < 0) {
    fail();
  }
  // Connections and files of the server are none of its business.
  syscall(SYS_close_range, 3u, ~0u, CLOSE_RANGE_CLOEXEC);
  execvp(arguments[0], arguments);
  fail();
  __builtin_unreachable();
}

struct Child {
  pid_t pid = -1;
  Descriptor output;
};

absl::StatusOr<Child> Start(const ChildCommand& command) {
  auto output = MakePipe();
  if (!output.ok()) return output.status();
  auto report = MakePipe();
  if (!report.ok()) return report.status();
  const Descriptor input(open("/dev/null", O_RDONLY | O_CLOEXEC));
  const Descriptor errors(
      open(command.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666));
  if (errors.get() < 0) return files::ErrnoStatus(errno, "create", command.log);

  std::vector<char*> arguments;
  for (const std::string& argument : command.arguments) {
    arguments.push_back(const_cast<char*>(argument.c_str()));
  }
  arguments.push_back(nullptr);

  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) return files::ErrnoStatus(errno, "start", command.arguments[0]);
  if (pid == 0) {
    BecomeChild(arguments.data(), command.yields, parent, input.get(), output->write.get(),
                errors.get(), report->write.get());
  }
  setpgid(pid, pid);  // here too: whoever is first, the group is there from now on
  report->write.Close();
  int reason = 0;
  ssize_t count;
  do {
    count = read(report->read.get(), &reason, sizeof reason);
  } while (count < 0 && errno == EINTR);
  if (count == sizeof reason) {  // exec failed; otherwise the pipe was closed by it
    while (waitpid(pid, nullptr, 0) < 0 && errno == EINTR) {
    }
    return files::ErrnoStatus(reason, "start", command.arguments[0]);
  }
  fcntl(output->read.get(), F_SETFL, O_NONBLOCK);
  return Child{pid, std::move(output->read)};
}

// Gathers bytes into lines.
class LineReader {
 public:
  explicit LineReader(const std::function<void(const std::string&)>& on_line) : on_line_(on_line) {}

  // Reads what is there in a pipe, at most what it holds: a process that writes faster than its
  // lines are taken must not keep its reader from stopping it. False at the end of the file.
  bool Drain(int descriptor) {
    char buffer[16 * 1024];
    for (int left = std::max(kPipeBytes, fcntl(descriptor, F_GETPIPE_SZ)); left > 0;) {
      const ssize_t count = read(descriptor, buffer, sizeof buffer);
      if (count > 0) {
        Take({buffer, static_cast<size_t>(count)});
        left -= static_cast<int>(count);
      } else if (count == 0) {
        return false;
      } else if (errno != EINTR) {
        return errno == EAGAIN;
      }
    }
    return true;
  }

 private:
  void Take(std::string_view bytes) {
    for (;;) {
      const size_t end = bytes.find('\n');
      const std::string_view part = bytes.substr(0, end);
      too_long_ = too_long_ || line_.size() + part.size() > kMaxLine;
      if (!too_long_) line_.append(part);
      if (end == std::string_view::npos) return;
      if (!too_long_) on_line_(line_);
      line_.clear();
      too_long_ = false;
      bytes.remove_prefix(end + 1);
    }
  }

  const std::function<void(const std::string&)>& on_line_;
  std::string line_;
  bool too_long_ = false;
};

// How many processes the system has killed since it started, for want of memory in it or in a
// control group; 0 where it does not say.
int64_t OutOfMemoryKills() {
  std::ifstream counters("/proc/vmstat");
  std::string name;
  int64_t value = 0;
  while (counters >> name >> value) {
    if (name == "oom_kill") return value;
  }
  return 0;
}

// Memory of its own that one process has, bytes; 0 where the system does not say.
int64_t OwnMemoryOf(const std::string& pid) {
  std::ifstream status("/proc/" + pid + "/status");
  std::string line;
  int64_t kibibytes = 0;
  while (std::getline(status, line)) {
    for (const std::string_view field : {"RssAnon:", "VmSwap:"}) {
      if (line.starts_with(field)) kibibytes += std::atoll(line.c_str() + field.size());
    }
  }
  return kibibytes * 1024;
}

// Returns the memory of a process and of the processes that its main thread started, in bytes.
int64_t OwnMemory(pid_t pid) {
  const std::string id = std::to_string(pid);
  int64_t bytes = OwnMemoryOf(id);
  std::ifstream children("/proc/" + id + "/task/" + id + "/children");
  for (std::string child; children >> child;) bytes += OwnMemoryOf(child);
  return bytes;
}

// Whether the process has ended; it stays a zombie, so that its group's id stays its own. If somebody
// else has reaped it, it has ended, too.
bool HasExited(pid_t pid) {
  siginfo_t about{};
  if (waitid(P_PID, static_cast<id_t>(pid), &about, WEXITED | WNOHANG | WNOWAIT) != 0) {
    return errno == ECHILD;
  }
  return about.si_pid == pid;
}

ChildResult Reap(pid_t pid) {
  kill(-pid, SIGKILL);
  int status = SIGKILL;  // if nobody knows how it ended
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  ChildResult result;
  if (WIFSIGNALED(status)) {
    result.signal = WTERMSIG(status);
  } else {
    result.exit_status = WEXITSTATUS(status);
  }
  return result;
}

}  // namespace

StopRequest::StopRequest() : descriptor_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

StopRequest::~StopRequest() {
  if (descriptor_ >= 0) close(descriptor_);
}

void StopRequest::Stop(Reason reason) {
  Reason none = Reason::kNone;
  reason_.compare_exchange_strong(none, reason);
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t ignored = write(descriptor_, &one, sizeof one);
}

bool StopRequest::Kill(Reason reason) {
  Stop(reason);
  const MutexLock lock(mutex_);
  const bool is_first = !std::exchange(kills_, true);
  if (group_ > 0) kill(-group_, SIGKILL);
  return is_first;
}

void StopRequest::SetGroup(pid_t group) {
  const MutexLock lock(mutex_);
  group_ = group;
  if (kills_ && group_ > 0) kill(-group_, SIGKILL);
}

absl::StatusOr<ChildResult> RunChild(const ChildCommand& command, StopRequest& stop,
                                     const std::function<void(const std::string&)>& on_line,
                                     const std::function<void()>& on_tick) {
  const int64_t kills_before = OutOfMemoryKills();
  auto child = Start(command);
  if (!child.ok()) return child.status();
  stop.SetGroup(child->pid);
  LineReader lines(on_line);
  const steady_clock::time_point begun = steady_clock::now();
  bool timed_out = false;
  bool over_memory_limit = false;
  std::optional<steady_clock::time_point> kill_at;  // set once it was asked to stop
  bool is_open = true;
  steady_clock::time_point next_tick = steady_clock::now() + kTick;
  while (!HasExited(child->pid)) {
    const auto now = steady_clock::now();
    const bool is_late = command.time_limit.count() > 0 && now - begun >= command.time_limit;
    if (!kill_at && (is_late || stop.reason() != StopRequest::Reason::kNone)) {
      timed_out = stop.reason() == StopRequest::Reason::kNone;
      kill(-child->pid, SIGTERM);
      kill_at = now + command.patience;
    }
    if (kill_at && now >= *kill_at) kill(-child->pid, SIGKILL);
    if (now >= next_tick) {
      if (command.memory_limit_bytes > 0 && OwnMemory(child->pid) > command.memory_limit_bytes) {
        over_memory_limit = true;
        kill(-child->pid, SIGKILL);
      }
      on_tick();
      next_tick = now + kTick;
    }
    // A negative descriptor is skipped by poll: a pipe at its end, a request that was heard.
    pollfd waits[] = {{is_open ? child->output.get() : -1, POLLIN, 0},
                      {kill_at ? -1 : stop.descriptor(), POLLIN, 0}};
    const milliseconds timeout = is_open && !kill_at ? kTick : kClosedTick;
    if (poll(waits, 2, static_cast<int>(timeout.count())) > 0 && waits[0].revents != 0) {
      is_open = lines.Drain(child->output.get());
    }
  }
  if (is_open) lines.Drain(child->output.get());
  stop.SetGroup(0);
  ChildResult result = Reap(child->pid);
  result.timed_out = timed_out;
  // If it had not ended by itself at that moment.
  result.over_memory_limit = over_memory_limit && result.signal == SIGKILL;
  result.out_of_memory = !kill_at && result.signal == SIGKILL && OutOfMemoryKills() > kills_before;
  return result;
}

}  // namespace maneuver::jobs
