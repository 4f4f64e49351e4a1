#include "server/jobs/trainer_run.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <system_error>

#include "server/jobs/job_folder.h"
#include "server/jobs/job_time.h"
#include "server/jobs/trainer_outcome.h"

namespace maneuver::jobs {
namespace {

// Returns how long the job's processes may still run: 0 or less if nothing is left; nothing if there
// is no limit.
std::optional<std::chrono::milliseconds> TimeLeft(const v1::Job& job, const JobLimits& limits,
                                                  absl::Time now) {
  if (limits.run_time.count() == 0) return std::nullopt;
  // An attempt may have several processes, one after another.
  const absl::Duration ran =
      ToDuration(job.attempts().earlier_run_time()) +
      std::max(absl::ZeroDuration(), now - ToTime(job.attempts().start_time()));
  return limits.run_time - absl::ToChronoMilliseconds(ran);
}

}  // namespace

Outcome RunTrainer(v1::Job& job, const std::vector<std::string>& arguments,
                   const std::filesystem::path& folder, const JobAttempt& attempt,
                   const std::vector<std::string>& launcher) {
  const JobRunEnvironment& environment = attempt.environment;
  const JobLimits& limits = environment.limits;
  ChildCommand command;
  command.arguments = launcher;
  command.arguments.push_back(environment.trainer);
  command.arguments.insert(command.arguments.end(), arguments.begin(), arguments.end());
  if (limits.threads > 0) {
    command.arguments.insert(command.arguments.end(),
                             {"--threads", std::to_string(limits.threads)});
  }
  command.log = folder / kLogFile;
  command.patience = environment.patience;
  command.memory_limit_bytes = limits.memory_bytes;
  if (const auto left = TimeLeft(job, limits, attempt.now())) {
    if (left->count() <= 0) return {WallTimeExceeded(limits.run_time)};
    command.time_limit = *left;
  }
  std::error_code error;
  const auto log_size = std::filesystem::file_size(command.log, error);
  const auto result = RunChild(
      command, attempt.stop, [&](const std::string& line) { attempt.progress.Record(line); },
      [&] { attempt.progress.Tick(); });
  attempt.progress.Flush();
  if (!result.ok()) return {CannotStartTrainer(result.status())};
  const std::vector<std::string> lines =
      LastLines(command.log, error ? 0 : static_cast<int64_t>(log_size));
  job.mutable_last_lines()->Assign(lines.begin(), lines.end());
  const bool is_done = result->signal == 0 && result->exit_status == 0;
  if (result->timed_out && !is_done) return {WallTimeExceeded(limits.run_time)};
  return {TrainerStatus(*result, lines.empty() ? std::string() : lines.back()), HasDied(*result)};
}

}  // namespace maneuver::jobs
