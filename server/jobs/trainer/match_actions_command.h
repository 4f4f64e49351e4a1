#ifndef MANEUVER_SERVER_JOBS_TRAINER_MATCH_ACTIONS_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_MATCH_ACTIONS_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/action_matching.pb.h"
#include "model/data/recording_blocks.h"
#include "model/inference/action_model.h"

namespace maneuver::trainer {

// maneuver-trainer match-actions: finds which actions of two model folders correspond.
class MatchActionsCommand {
 public:
  explicit MatchActionsCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  absl::Status Print() const;
  absl::StatusOr<v1::ActionMatching> Match(const inference::ActionModel& first,
                                           const inference::ActionModel& second) const;

  CLI::App* command_;
  std::filesystem::path first_;
  std::filesystem::path second_;
  std::filesystem::path dataset_;
  std::filesystem::path output_;
  int threads_ = 0;
  int64_t data_memory_ = data::kDefaultDataMemory;  // bytes
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_MATCH_ACTIONS_COMMAND_H_
