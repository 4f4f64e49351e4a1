#ifndef MANEUVER_SERVER_JOBS_TRAINER_PRUNE_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_PRUNE_COMMAND_H_

#include <CLI/CLI.hpp>
#include <filesystem>

#include "absl/status/status.h"
#include "model/artifact/model_folder.h"

namespace maneuver::trainer {

// maneuver-trainer prune: copies a model folder without the actions that are not effective.
class PruneCommand {
 public:
  explicit PruneCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  absl::Status Prune() const;
  // Writes the output, with the baselines of the whole model, completely or not at all.
  absl::Status Write(artifact::StoredModel pruned) const;

  CLI::App* command_;
  std::filesystem::path model_;
  std::filesystem::path output_;
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_PRUNE_COMMAND_H_
