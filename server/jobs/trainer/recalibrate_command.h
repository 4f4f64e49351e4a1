#ifndef MANEUVER_SERVER_JOBS_TRAINER_RECALIBRATE_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RECALIBRATE_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/data/recording_blocks.h"

namespace maneuver::trainer {

// maneuver-trainer recalibrate: fits the widths and the temperature of a model folder to dataset
// folders, and writes a new model folder.
class RecalibrateCommand {
 public:
  explicit RecalibrateCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  absl::Status Recalibrate() const;

  CLI::App* command_;
  std::filesystem::path model_;
  std::string model_name_;  // empty: that of the folder
  std::vector<std::filesystem::path> datasets_;
  std::vector<std::string> dataset_names_;  // empty: those of the folders
  std::filesystem::path settings_;
  std::filesystem::path output_;
  int threads_ = 0;                                 // 0: one for each core
  int64_t data_memory_ = data::kDefaultDataMemory;  // bytes
  std::string progress_ = "bar";
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RECALIBRATE_COMMAND_H_
