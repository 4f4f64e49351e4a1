#ifndef MANEUVER_SERVER_JOBS_TRAINER_TRAIN_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_TRAIN_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "model/data/recording_blocks.h"

namespace maneuver::trainer {

// maneuver-trainer train: learns a model folder from dataset folders.
class TrainCommand {
 public:
  explicit TrainCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Trains, and returns the exit status of the program.
  //   arguments: of the program, with its name first
  int Run(const std::vector<std::string>& arguments) const;

 private:
  absl::Status Train() const;
  // Returns about how long the evaluations that follow will take, in seconds; 0 if that cannot be
  // told.
  double SecondsAfter() const;

  CLI::App* command_;
  std::filesystem::path settings_;
  std::vector<std::filesystem::path> datasets_;
  std::vector<std::string> dataset_names_;
  std::filesystem::path start_from_;
  std::string start_from_name_;
  std::filesystem::path output_;
  std::filesystem::path checkpoints_;
  double checkpoint_interval_ = 60.0;               // seconds
  int64_t data_memory_ = data::kDefaultDataMemory;  // bytes
  bool baselines_ = false;
  int64_t checkpoint_steps_ = 0;
  int checkpoints_kept_ = 2;
  int least_actions_ = 0;
  int threads_ = 0;
  int ranks_ = 0;
  double rank_timeout_ = 60.0;  // seconds
  // The evaluations that follow the training and that its progress counts.
  std::filesystem::path next_model_;
  std::filesystem::path next_dataset_;
  std::filesystem::path next_settings_;
  int next_count_ = 0;
  std::string progress_ = "bar";
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_TRAIN_COMMAND_H_
