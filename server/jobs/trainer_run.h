// Runs the trainer once for a job.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_RUN_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RUN_H_

#include <filesystem>
#include <string>
#include <vector>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

// Runs the trainer with these arguments until it ends, within the job's limits. OK if the trainer
// reports success. Records the last lines of its log in the job.
//   folder: holds its log (job_folder.h).
//   launcher: what starts the trainer, as in JobRunEnvironment but without {ranks}; empty: nothing
Outcome RunTrainer(v1::Job& job, const std::vector<std::string>& arguments,
                   const std::filesystem::path& folder, const JobAttempt& attempt,
                   const std::vector<std::string>& launcher = {});

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RUN_H_
