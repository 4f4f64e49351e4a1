#ifndef MANEUVER_SERVER_JOBS_TRAINER_EVALUATE_COMMAND_H_
#define MANEUVER_SERVER_JOBS_TRAINER_EVALUATE_COMMAND_H_

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_blocks.h"
#include "server/jobs/trainer/progress_display.h"

namespace maneuver::trainer {

// maneuver-trainer evaluate: evaluates a model folder on a dataset folder. Prints the report, or
// with --progress json only its progress.
class EvaluateCommand {
 public:
  explicit EvaluateCommand(CLI::App& app);

  // Runs the command and returns the exit status of the program.
  int Run() const;

 private:
  absl::Status Evaluate() const;
  absl::StatusOr<v1::EvaluationReport> Measure(const v1::ExampleSettings& examples,
                                               ProgressDisplay::Style style) const;

  std::filesystem::path model_;
  std::filesystem::path dataset_;
  std::filesystem::path output_;
  std::filesystem::path settings_;
  int sampled_examples_ = 0;                        // that the report contains
  int threads_ = 0;                                 // 0: one for each core
  int64_t data_memory_ = data::kDefaultDataMemory;  // bytes
  std::string progress_ = "bar";
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_EVALUATE_COMMAND_H_
