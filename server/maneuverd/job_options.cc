#include "server/maneuverd/job_options.h"

#include <cmath>
#include <limits>

#include "model/machine/usable_cores.h"
#include "model/machine/usable_memory.h"
#include "server/jobs/trainer/number_checks.h"
#include "server/maneuverd/option_kinds.h"

namespace maneuver {
namespace {

constexpr int64_t kBytesPerMebibyte = int64_t{1} << 20;
constexpr double kMostDays = 36'500.0;

absl::Duration DaysOrForever(double days) {
  return days > 0.0 ? 24.0 * days * absl::Hours(1) : absl::InfiniteDuration();
}

}  // namespace

void AddJobOptions(CLI::App& app, JobOptions& options) {
  app.add_option("--trainer", options.trainer, "The program that trains")->capture_default_str();
  app.add_option(
         "--trainer-command", options.trainer_command,
         "Command that starts the trainer of a training job, words separated by spaces, such as "
         "\"srun -n{ranks} --export=ALL\"; {ranks} is the job's number of processes. Empty: "
         "the trainer starts its processes itself, on this machine")
      ->capture_default_str();
  app.add_option("--max-running-jobs", options.max_running, "Most jobs that run at the same time")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--job-ranks", options.ranks,
                 "Most processes of a training job that this server takes, of several that share; "
                 "0: one for each core, or any number with --trainer-command")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  AddBytes(app, "--job-memory", options.memory,
           "Most memory of a job that this server takes, of several that share, such as "
           "24GiB; 0: the machine's, divided by --max-running-jobs, or any with --trainer-command",
           Least::kZero);
  app.add_option("--max-pending-jobs", options.max_pending,
                 "Most waiting jobs; above it new jobs are refused")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--trainer-threads", options.limits.threads,
                 "Threads of each job, overriding its settings; 0: as in its settings, or one for "
                 "each core")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  AddScaled<double>(app, "--job-memory-limit", "0", FiniteRange(0.0, 1e9),
                    "Most memory of a job's process, MiB, without memory-mapped files; 0: no limit",
                    [&options](double mebibytes) {
                      options.limits.memory_bytes =
                          std::llround(mebibytes * static_cast<double>(kBytesPerMebibyte));
                    });
  AddBytes(app, "--data-memory", options.limits.data_memory,
           "Memory that the recordings of a job may take, such as 2GiB; data that do not fit "
           "are read piece by piece");
  AddScaled<double>(app, "--job-time-limit", "0", FiniteRange(0.0, 1e9),
                    "Most seconds that a job runs; 0: no limit",
                    [&options](double seconds) { options.limits.run_time = Seconds(seconds); });
  app.add_option(
         "--job-attempts", options.limits.attempts_without_progress,
         "Fail a job after this many of its processes in a row died without a new checkpoint")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option(
         "--job-least-actions", options.least_effective_actions,
         "Fail a training job whose model uses fewer actions than this on held-out examples")
      ->check(CLI::Range(0, 100'000))
      ->capture_default_str();
  AddScaled<double>(app, "--checkpoint-interval", "60", FiniteRange(0.0, 86'400),
                    "Seconds between two checkpoints", [&options](double seconds) {
                      options.checkpoints.interval = Seconds(seconds);
                    });
  app.add_option("--checkpoint-steps", options.checkpoints.steps,
                 "Also write a checkpoint after this many steps; 0: by time only")
      ->check(CLI::Range(int64_t{0}, int64_t{1'000'000'000}))
      ->capture_default_str();
  app.add_option("--checkpoints-kept", options.checkpoints.kept,
                 "Number of latest checkpoints that a job keeps")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  AddBytes(app, "--tag-quota", options.tag_quota_bytes,
           "Most bytes of all tags together, such as 50GiB; 0: no limit but the disk. Checked "
           "after each shard",
           Least::kZero);
  AddScaled<double>(app, "--keep-jobs", "90", FiniteRange(0.0, kMostDays),
                    "Days to keep a job after its end; 0: for ever",
                    [&options](double days) { options.retention.jobs = DaysOrForever(days); });
  AddScaled<double>(
      app, "--keep-checkpoints", "14", FiniteRange(0.0, kMostDays),
      "Days to keep the checkpoints of a failed or cancelled job; 0: for ever",
      [&options](double days) { options.retention.checkpoints = DaysOrForever(days); });
  app.add_option(
         "--keep-versions", options.retention.versions,
         "Number of newest versions of each model to keep, beside those with an alias; 0: all")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
}

int64_t RanksForAJob(const JobOptions& options) {
  if (options.ranks > 0) return options.ranks;
  return options.trainer_command.empty() ? machine::UsableCores()
                                         : std::numeric_limits<int64_t>::max();
}

int64_t MemoryForAJob(const JobOptions& options) {
  if (options.memory > 0) return options.memory;
  return options.trainer_command.empty() ? machine::UsableMemory() / options.max_running
                                         : std::numeric_limits<int64_t>::max();
}

}  // namespace maneuver
