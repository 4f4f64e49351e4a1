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

// A program of ours, running. Killed when this goes away.
class ChildProcess {
 public:
  // Standard output and error go to `log`, which is appended to.
  ChildProcess(const std::vector<std::string>& command, const std::filesystem::path& log);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  void Signal(int signal);
  // Exit status, or 128 + the signal that ended it; nothing if it still runs after `patience`.
  std::optional<int> Wait(std::chrono::seconds patience);

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
};

// Runs a command to its end; its exit status, output in *output.
int Run(const std::vector<std::string>& command, std::string* output);

// Polls until `condition` holds; false if it does not within `patience`.
bool WaitFor(const std::function<bool()>& condition, std::chrono::seconds patience);

// A new folder under the system's temporary one, removed when this goes away.
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
