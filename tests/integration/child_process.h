#ifndef MANEUVER_TESTS_INTEGRATION_CHILD_PROCESS_H_
#define MANEUVER_TESTS_INTEGRATION_CHILD_PROCESS_H_

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace maneuver::integration {

// A running program. The destructor kills it.
class ChildProcess {
 public:
  // Starts a program. Appends its standard output and error to `log`.
  ChildProcess(const std::vector<std::string>& command, const std::filesystem::path& log);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  void Signal(int signal);
  // Returns the exit status, or 128 + the signal that ended it; nothing if it still runs after
  // `patience`.
  std::optional<int> Wait(std::chrono::seconds patience);

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

// Runs a command to its end. Returns its exit status, with the output in *output.
int Run(const std::vector<std::string>& command, std::string* output);

// Polls until `condition` holds. Returns false if it does not within `patience`.
bool WaitFor(const std::function<bool()>& condition, std::chrono::seconds patience);

// A new folder below the system's temporary one. The destructor removes it.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_CHILD_PROCESS_H_
