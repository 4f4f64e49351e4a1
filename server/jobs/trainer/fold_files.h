// What each model of a cross-validation measured, kept so that an interrupted one goes on.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_FOLD_FILES_H_
#define MANEUVER_SERVER_JOBS_TRAINER_FOLD_FILES_H_

#include <filesystem>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/cross_validation.pb.h"

namespace maneuver::trainer {

// A folder of files checkpoint-1, checkpoint-2 and so on, a CrossValidationPart with one run each.
// They are checkpoints to those who supervise the process: see ../trainer_protocol.h.
class FoldFiles {
 public:
  // Reads what is there, and makes the folder if there is none. DATA_LOSS if a file is damaged or
  // of another cross-validation.
  //   plan: of this cross-validation
  static absl::StatusOr<FoldFiles> Open(std::filesystem::path folder, v1::CrossValidationPlan plan);

  // What was found.
  const std::vector<v1::FoldRun>& runs() const { return runs_; }

  // Keeps what another model measured, in one step.
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
