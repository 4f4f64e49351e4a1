// What the end of a trainer process means to the people who asked for the job.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_
#define MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_

#include <filesystem>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "server/jobs/child_process.h"

namespace maneuver::jobs {

// OK for exit status 0; otherwise an error with one of these reasons as its ErrorInfo:
//   INVALID_SETTINGS, UNUSABLE_DATA, CANNOT_WRITE, TRAINING_DIVERGED, TRAINER_INTERNAL
//   TRAINER_KILLED   by a signal; metadata signal = its number
//   last_words: LastLine of its log; becomes part of the message.
absl::Status TrainerStatus(const ChildResult& result, const std::string& last_words);

// The trainer could not even be started: TRAINER_INTERNAL.
absl::Status CannotStartTrainer(const absl::Status& reason);

// The server stopped while the job ran: SERVER_INTERRUPTED.
absl::Status ServerInterrupted();

// The last line of a log that says something, fit for an error message: valid UTF-8, no control
// characters, no paths (WithoutPaths), at most 400 bytes. Empty if there is none.
std::string LastLine(const std::filesystem::path& log);

// `text` with each absolute path cut down to its last part: "/data/jobs/a/output" becomes "output".
std::string WithoutPaths(std::string_view text);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_OUTCOME_H_
