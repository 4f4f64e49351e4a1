// Translates the end of a trainer process into an error for the people who asked for the job.

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

// Returns OK for exit status 0, otherwise an error with one of these reasons as its ErrorInfo:
//   INVALID_SETTINGS, UNUSABLE_DATA, NOT_ENOUGH_EXAMPLES, DISK_FULL, CANNOT_WRITE,
//     TRAINING_DIVERGED, ACTIONS_COLLAPSED, METRICS_NOT_FINITE, TAG_QUOTA, TRAINER_INTERNAL
//   OUT_OF_MEMORY: it exceeded its memory limit, or the system killed it for lack of memory
//   TRAINER_DIED: killed by a signal; metadata signal = its number
//   RANK_LOST: one of several processes ended or did not answer
// Does not look at ChildResult.timed_out: see WallTimeExceeded.
//   last_words: the trainer's last line; becomes part of the message.
absl::Status TrainerStatus(const ChildResult& result, const std::string& last_words);

// Returns `status` without paths, and with a reason: DISK_FULL if it is RESOURCE_EXHAUSTED, else
// `reason`. Returns it unchanged if the store is away, and FOLDER_UNAVAILABLE if a file system
// failed.
absl::Status WithDefaultReason(absl::Status status, errors::Reason reason);

// Returns the error of a trainer that could not be started: TRAINER_INTERNAL, or what
// WithDefaultReason says of a disk that is full or fails.
absl::Status CannotStartTrainer(const absl::Status& reason);

// Returns whether the process was ended by a signal or lost a rank, though it was within its limits
// of time and memory. Then another process should continue the job, unless the server asked this
// one to stop.
bool HasDied(const ChildResult& result);

// Returns the error of a job whose server stopped or died while it ran: SERVER_INTERRUPTED.
absl::Status ServerInterrupted();

// Returns the error of a job after too many attempts: `last`, the error of its last process, with
// the same reason.
//   processes: how many in a row left no new checkpoint.
absl::Status GaveUp(absl::Status last, int processes);

// Returns the error of a tagging that would exceed the quota of tags: TAG_QUOTA.
absl::Status TagQuotaReached();

// Returns the error of a job that ran for as long as it may: WALL_TIME_EXCEEDED.
absl::Status WallTimeExceeded(std::chrono::milliseconds limit);

// Returns the last nonempty lines of a log, at most eight and all within its last 8 KiB, fit for an
// error message: valid UTF-8, no control characters, no paths (WithoutPaths), each at most about
// 400 bytes.
//   from: size of the log in bytes when the process began to write
std::vector<std::string> LastLines(const std::filesystem::path& log, int64_t from = 0);

// Returns `text` with each absolute path cut down to its last part: "/data/jobs/a/output" becomes
// "output".
std::string WithoutPaths(std::string_view text);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_
