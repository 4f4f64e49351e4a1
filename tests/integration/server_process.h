#ifndef MANEUVER_TESTS_INTEGRATION_SERVER_PROCESS_H_
#define MANEUVER_TESTS_INTEGRATION_SERVER_PROCESS_H_

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/integration/child_process.h"

namespace maneuver::integration {

// Runs maneuverd on free ports of loopback, over a data folder.
class ServerProcess {
 public:
  // Starts it and waits until it listens. `flags` are added to the command.
  explicit ServerProcess(const std::filesystem::path& data_dir,
                         std::vector<std::string> flags = {});

  const std::string& address() const { return address_; }
  const std::string& metrics_address() const { return metrics_address_; }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }
  pid_t pid() const { return process_->pid(); }

  // Sends SIGTERM and returns the exit status.
  std::optional<int> Terminate();
  // Sends SIGKILL and waits until the process is gone.
  void Kill();
  // Returns the process ids of the trainers that it started.
  std::vector<pid_t> Trainers() const;
  // Returns whether the process runs and answers SERVING or NOT_SERVING.
  bool Alive();

 private:
  std::string address_;
  std::string metrics_address_;
  std::unique_ptr<ChildProcess> process_;
  std::shared_ptr<grpc::Channel> channel_;
};

// Runs the `maneuver` command against a server. Returns its exit status, with the output in
// *output.
int RunManeuver(const ServerProcess& server, std::vector<std::string> arguments,
                std::string* output);

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_SERVER_PROCESS_H_
