#ifndef MANEUVER_SERVER_JOBS_TRAINER_CROSS_VALIDATE_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_CROSS_VALIDATE_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/cross_validation.pb.h"
#include "model/learning/cross_validation.h"

namespace maneuver::trainer {

// maneuver-trainer cross-validate: measures settings on all recordings of datasets. The model that
// measures a recording has not learned from any recording of its group.
class CrossValidateCommand {
 public:
  explicit CrossValidateCommand(CLI::App& app);

  bool chosen() const { return command_->parsed(); }
  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  absl::Status CrossValidate() const;
  absl::StatusOr<learning::CrossValidation> Prepare() const;
  absl::StatusOr<v1::CrossValidationPart> Measure() const;
  absl::StatusOr<std::vector<v1::CrossValidationPart>> ReadParts() const;
  absl::Status Report(std::vector<v1::CrossValidationPart> parts) const;

  CLI::App* command_;
  std::filesystem::path settings_;
  std::vector<std::filesystem::path> datasets_;
  std::vector<std::string> dataset_names_;  // empty: those of the folders
  std::vector<std::string> test_datasets_;  // NAME=FOLDER
  int folds_ = 5;
  int64_t fold_seed_ = 1;
  std::vector<int64_t> seeds_;
  int only_fold_ = 0;  // 0: all
  bool baselines_ = false;
  bool plan_only_ = false;
  std::filesystem::path models_;
  std::filesystem::path checkpoints_;
  std::filesystem::path part_;
  std::vector<std::filesystem::path> merge_;
  std::filesystem::path output_;
  int resamples_ = 1000;
  int64_t data_memory_ = data::kDefaultDataMemory;
  int threads_ = 0;
  std::string progress_ = "bar";
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_CROSS_VALIDATE_COMMAND_H_
