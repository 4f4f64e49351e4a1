// What the end of a trainer process means to the people who asked for the job.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_
#define MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "server/errors/error_details.h"
#include "server/jobs/child_process.h"

namespace maneuver::jobs {

// OK for exit status 0; otherwise an error with one of these reasons as its ErrorInfo:
//   INVALID_SETTINGS, UNUSABLE_DATA, NOT_ENOUGH_EXAMPLES, DISK_FULL, CANNOT_WRITE,
//   TRAINING_DIVERGED, ACTIONS_COLLAPSED, METRICS_NOT_FINITE, TRAINER_INTERNAL
//   OUT_OF_MEMORY        more than its limit, or killed by the system for want of it
//   WALL_TIME_EXCEEDED
//   TRAINER_DIED         by a signal; metadata signal = its number
//   last_words: its last line; becomes part of the message.
absl::Status TrainerStatus(const ChildResult& result, const std::string& last_words);

// Returns `status` without paths, and with a reason: DISK_FULL if it is RESOURCE_EXHAUSTED, else
// `reason`.
absl::Status WithDefaultReason(absl::Status status, errors::Reason reason);

// The trainer could not even be started: TRAINER_INTERNAL.
absl::Status CannotStartTrainer(const absl::Status& reason);

// Whether a process ended for no reason of its own, so that another one is to go on: by a signal
// that nobody here sent it.
bool HasDied(const ChildResult& result);

// The server stopped or died while the job ran: SERVER_INTERRUPTED.
absl::Status ServerInterrupted();

// `last`, why the last process ended, once too many ended so: the same reason.
//   processes: how many in a row left no new checkpoint.
absl::Status GaveUp(absl::Status last, int processes);

// The job ran for as long as it may: WALL_TIME_EXCEEDED.
absl::Status WallTimeExceeded(std::chrono::milliseconds limit);

// The last few lines of a log that say something, fit for an error message: valid UTF-8, no control
// characters, no paths (WithoutPaths), each at most 400 bytes.
//   from: where in the log the process began to write, bytes.
std::vector<std::string> LastLines(const std::filesystem::path& log, int64_t from = 0);

// `text` with each absolute path cut down to its last part: "/data/jobs/a/output" becomes "output".
std::string WithoutPaths(std::string_view text);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_
