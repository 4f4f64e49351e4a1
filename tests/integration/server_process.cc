#include "tests/integration/server_process.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

namespace maneuver::integration {

ServerProcess::ServerProcess(const std::filesystem::path& data_dir,
                             std::vector<std::string> flags) {
  const std::filesystem::path ports = data_dir.string() + ".ports.json";
  std::filesystem::remove(ports);
  std::vector<std::string> command = {MANEUVERD,     "--data-dir",  data_dir.string(),
                                      "--listen",    "127.0.0.1:0", "--metrics-listen",
                                      "127.0.0.1:0", "--port-file", ports.string()};
  command.insert(command.end(), flags.begin(), flags.end());
  process_ = std::make_unique<ChildProcess>(command, data_dir.string() + ".log");
  const bool listens =
      WaitFor([&] { return std::filesystem::exists(ports); }, std::chrono::seconds(30));
  if (!listens) {
    ADD_FAILURE() << "maneuverd does not listen; see " << data_dir.string() << ".log";
    return;
  }
  const nlohmann::json addresses = nlohmann::json::parse(std::ifstream(ports));
  address_ = addresses.at("grpc");
  metrics_address_ = addresses.at("metrics");
  channel_ = grpc::CreateChannel(address_, grpc::InsecureChannelCredentials());
}

std::optional<int> ServerProcess::Terminate() {
  process_->Signal(SIGTERM);
  return process_->Wait(std::chrono::seconds(30));
}

void ServerProcess::Kill() {
  process_->Signal(SIGKILL);
  process_->Wait(std::chrono::seconds(30));
}

std::vector<pid_t> ServerProcess::Trainers() const {
  std::vector<pid_t> trainers;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream stat(entry.path() / "stat");
    std::string id, command, state;
    pid_t parent = 0;
    stat >> id >> command >> state >> parent;
    if (parent == pid() && command.starts_with("(maneuver-train") && state != "Z") {
      trainers.push_back(std::stoi(name));
    }
  }
  return trainers;
}

bool ServerProcess::Alive() { return !process_->Wait(std::chrono::seconds(0)).has_value(); }

int RunManeuver(const ServerProcess& server, std::vector<std::string> arguments,
                std::string* output) {
  std::vector<std::string> command = {MANEUVER, "--server", server.address()};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return Run(command, output);
}

}  // namespace maneuver::integration
