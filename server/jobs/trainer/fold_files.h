// Keeps the measurements of each model of a cross-validation, so that an interrupted one can
// continue.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_FOLD_FILES_H_
#define MANEUVER_SERVER_JOBS_TRAINER_FOLD_FILES_H_

#include <filesystem>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/cross_validation.pb.h"

namespace maneuver::trainer {

// A folder of files checkpoint-1, checkpoint-2 and so on. Each holds a CrossValidationPart with one
// run. To the supervisor they are checkpoints: see ../trainer_protocol.h.
class FoldFiles {
 public:
  // Reads the files, and creates the folder if it is missing. The error (errno_status.h) of a
  // folder that cannot be created. DATA_LOSS if a file is damaged or belongs to another
  // cross-validation.
  //   plan: the plan of this cross-validation
  static absl::StatusOr<FoldFiles> Open(std::filesystem::path folder, v1::CrossValidationPlan plan);

  // Returns the runs that Open found.
  const std::vector<v1::FoldRun>& runs() const { return runs_; }

  // Writes the run of another model, in one step.
  absl::Status Add(const v1::FoldRun& run);

 private:
  FoldFiles(std::filesystem::path folder, v1::CrossValidationPlan plan)
      : folder_(std::move(folder)), plan_(std::move(plan)) {}

  std::filesystem::path folder_;
  v1::CrossValidationPlan plan_;
  std::vector<v1::FoldRun> runs_;
  int files_ = 0;
};

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_FOLD_FILES_H_
