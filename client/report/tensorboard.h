// Writes learning curves as event files for TensorBoard.

#ifndef MANEUVER_CLIENT_REPORT_TENSORBOARD_H_
#define MANEUVER_CLIENT_REPORT_TENSORBOARD_H_

#include <filesystem>
#include <span>

#include "absl/status/status.h"
#include "client/report/learning_curves.h"

namespace maneuver::report {

// Writes one TensorBoard run into each of the folders `training`, `held-out` and `mixture` of
// `folder`, so that TensorBoard draws training and held-out examples into the same chart. Tags are
// PHASE/TERM; steps count from the start of the job. Creates the folders and replaces the files of
// an earlier call. A run without figures is left out. FAILED_PRECONDITION names the path that
// cannot be written.
absl::Status WriteTensorBoard(std::span<const LearningPhase> phases,
                              const std::filesystem::path& folder);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_TENSORBOARD_H_
