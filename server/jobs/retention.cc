#include "server/jobs/retention.h"

#include <iterator>
#include <map>
#include <optional>
#include <utility>

#include "absl/time/clock.h"
#include "server/jobs/job_state.h"
#include "server/jobs/job_time.h"
#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

}  // namespace

std::vector<security::ModelVersionName> VersionsToDelete(
    const RetentionPolicy& policy,
    const std::vector<serving::ModelVersions::ListedVersion>& versions,
    const std::set<std::string>& needed) {
  std::vector<security::ModelVersionName> given_up;
  if (policy.versions <= 0) return given_up;
  // By their numbers: the time of a version is that of a file, by a clock that may have been set.
  std::map<std::string, std::set<int>> numbers;
  for (const auto& version : versions) numbers[version.name.model].insert(version.name.version);
  for (const auto& [name, has_alias, maker] : versions) {
    const std::set<int>& of_model = numbers[name.model];
    const auto newer = std::distance(of_model.upper_bound(name.version), of_model.end());
    if (newer < policy.versions || has_alias) continue;
    if (needed.contains(name.ToString()) || needed.contains(maker)) continue;
    given_up.push_back(name);
  }
  return given_up;
}

Retention::Retention(const RetentionPolicy& policy, Supervisor& jobs,
                     serving::ModelVersions& versions)
    : policy_(policy), jobs_(jobs), versions_(versions) {}

Retention::~Retention() {
  stop_.Stop();
  if (thread_.joinable()) thread_.join();
}

absl::Status Retention::Sweep(absl::Time now) {
  absl::Status status = SweepJobs(now);
  status.Update(SweepVersions());
  for (const auto& sweep : others_) status.Update(sweep());
  return status;
}

absl::Status Retention::SweepJobs(absl::Time now) {
  constexpr int kPage = 1'000;
  absl::Status result;
  std::string token;
  do {
    const auto page = jobs_.store().List(kPage, token);
    if (!page.ok()) return page.status();
    for (const DamagedJob& job : page->damaged) result.Update(job.error);
    for (const v1::Job& job : page->jobs) {
      if (!HasEnded(job.state())) continue;
      const absl::Duration age = now - ToTime(job.end_time());
      if (age > policy_.jobs) {
        const absl::Status status = jobs_.Delete(job.name());
        // Somebody resumed or deleted it in between.
        if (absl::IsFailedPrecondition(status) || absl::IsNotFound(status)) continue;
        result.Update(status);
        if (status.ok()) Log(LogLevel::kInfo, "old job forgotten", {{"job", job.name()}});
      } else if (age > policy_.checkpoints) {
        const auto dropped = jobs_.DropCheckpoints(job.name());
        if (absl::IsNotFound(dropped.status())) continue;
        result.Update(dropped.status());
        if (dropped.ok() && *dropped) {
          Log(LogLevel::kInfo, "old checkpoints removed", {{"job", job.name()}});
        }
      }
    }
    token = page->next_page_token;
  } while (!token.empty());
  return result;
}

absl::Status Retention::SweepVersions() {
  if (policy_.versions <= 0) return absl::OkStatus();
  std::set<std::string> needed;
  for (const v1::JobState state : {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING}) {
    const auto jobs = jobs_.store().ListInState(state, std::nullopt);
    if (!jobs.ok()) return jobs.status();
    for (const v1::Job& job : *jobs) {
      needed.insert(job.name());
      if (job.has_train()) needed.insert(job.train().start_from());
      if (job.has_evaluate()) needed.insert(job.evaluate().model());
      if (job.has_recalibrate()) needed.insert(job.recalibrate().model());
      if (job.has_tag()) needed.insert(job.tag().model());
    }
  }
  needed.erase("");  // of a training that starts from nothing
  absl::Status result;
  for (const auto& version : VersionsToDelete(policy_, versions_.List(), needed)) {
    const absl::Status status = versions_.Delete(version);
    if (absl::IsFailedPrecondition(status) || absl::IsNotFound(status)) continue;
    result.Update(status);
    if (status.ok()) {
      Log(LogLevel::kInfo, "old model version deleted", {{"model_version", version.ToString()}});
    }
  }
  return result;
}

void Retention::SweepRegularly(absl::Duration interval) {
  thread_ = std::thread([this, interval] {
    do {
      if (const absl::Status status = Sweep(absl::Now()); !status.ok()) {
        Log(LogLevel::kWarning, "could not remove everything that is due for removal",
            {{"reason", std::string(status.message())}});
      }
    } while (!stop_.StoppedWithin(absl::ToChronoNanoseconds(interval)));
  });
}

}  // namespace maneuver::jobs
