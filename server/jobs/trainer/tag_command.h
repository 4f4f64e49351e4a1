#ifndef MANEUVER_SERVER_JOBS_TRAINER_TAG_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_TAG_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/tags/tag_datasets.h"

namespace maneuver::trainer {

// maneuver-trainer tag: tags dataset folders with a model folder, in f32. Writes the same files as
// maneuver tag, and counts the complete shards as checkpoints.
class TagCommand {
 public:
  explicit TagCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  // Sets *no_room if the files would take more than room_.
  absl::Status Tag(bool* no_room) const;
  // Replaces the checkpoint by one with this number of shards.
  absl::Status KeepCheckpoint(int64_t shards) const;

  CLI::App* const command_;
  std::filesystem::path model_;
  std::vector<std::filesystem::path> datasets_;
  std::filesystem::path output_;
  std::filesystem::path checkpoints_;
  int part_ = 0;
  int parts_ = 1;
  bool windows_ = false;
  std::optional<double> stride_;
  std::optional<int64_t> room_;  // bytes that are written at most, checked after each shard
  int threads_ = 0;              // 0: one for each core
  std::string progress_ = "bar";
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_TAG_COMMAND_H_
