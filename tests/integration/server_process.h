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

// maneuverd on free ports of loopback, over a data folder.
class ServerProcess {
 public:
  // Waits until it listens. `flags` are added to the command.
  explicit ServerProcess(const std::filesystem::path& data_dir,
                         std::vector<std::string> flags = {});

  const std::string& address() const { return address_; }
  const std::string& metrics_address() const { return metrics_address_; }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }
  pid_t pid() const { return process_->pid(); }

  // SIGTERM, and the exit status.
  std::optional<int> Terminate();
  // SIGKILL, and waits until it is gone.
  void Kill();
  // Process ids of the trainers that it started.
  std::vector<pid_t> Trainers() const;
  // The process still runs and says SERVING or NOT_SERVING when asked.
  bool Alive();

 private:
  std::string address_;
  std::string metrics_address_;
  std::unique_ptr<ChildProcess> process_;
  std::shared_ptr<grpc::Channel> channel_;
};

// The `maneuver` command against a server; its exit status, output in *output.
int RunManeuver(const ServerProcess& server, std::vector<std::string> arguments,
                std::string* output);

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_SERVER_PROCESS_H_
