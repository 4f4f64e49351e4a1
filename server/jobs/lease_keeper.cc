#include "server/jobs/lease_keeper.h"

#include <utility>
#include <vector>

#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

constexpr std::chrono::milliseconds kGuardInterval{200};

void Kill(const JobLease& lease, StopRequest& run) {
  // Its reason does not tell: the job may have been cancelled before.
  if (!run.Kill(StopRequest::Reason::kLeaseLost)) return;
  Log(LogLevel::kWarning, "job was killed: its lease could not be renewed", {{"job", lease.job}});
}

}  // namespace

LeaseKeeper::LeaseKeeper(JobStore& store, std::function<void()> beat, std::function<Time()> now)
    : store_(store), lease_time_(*store.LeaseTime()), beat_(std::move(beat)), now_(std::move(now)) {
  renewer_ = std::thread([this] {
    while (!stop_.StoppedWithin(lease_time_ / 8)) Renew();
  });
  guard_ = std::thread([this] {
    while (!stop_.StoppedWithin(kGuardInterval)) Guard();
  });
}

LeaseKeeper::~LeaseKeeper() {
  stop_.Stop();
  renewer_.join();
  guard_.join();
}

void LeaseKeeper::Keep(const JobLease& lease, std::shared_ptr<StopRequest> run, Time since) {
  const MutexLock lock(mutex_);
  kept_[lease.job] = {lease, std::move(run), since};
}

void LeaseKeeper::Release(const std::string& job) {
  const MutexLock lock(mutex_);
  kept_.erase(job);
}

void LeaseKeeper::Renew() {
  std::vector<Kept> all;
  {
    const MutexLock lock(mutex_);
    for (const auto& [job, kept] : kept_) all.push_back(kept);
  }
  for (const Kept& kept : all) RenewOne(kept);
  beat_();
}

void LeaseKeeper::RenewOne(const Kept& kept) {
  const Time now = now_();
  const absl::StatusOr<bool> is_cancelled = store_.Renew(kept.lease);
  if (is_cancelled.ok()) {
    if (*is_cancelled) kept.run->Stop(StopRequest::Reason::kCancelled);
    const MutexLock lock(mutex_);
    const auto found = kept_.find(kept.lease.job);
    if (found != kept_.end() && found->second.lease.fence == kept.lease.fence) {
      found->second.renewed_at = now;
    }
  } else if (absl::IsAborted(is_cancelled.status())) {
    Kill(kept.lease, *kept.run);
  }
}

void LeaseKeeper::Guard() {
  const Time oldest = now_() - lease_time_ * 2 / 3;
  const MutexLock lock(mutex_);
  for (const auto& [job, kept] : kept_) {
    if (kept.renewed_at < oldest) Kill(kept.lease, *kept.run);
  }
}

}  // namespace maneuver::jobs
