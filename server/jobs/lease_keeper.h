// Keeps the leases of running jobs in a store that several servers share.

#ifndef MANEUVER_SERVER_JOBS_LEASE_KEEPER_H_
#define MANEUVER_SERVER_JOBS_LEASE_KEEPER_H_

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "locks/stop_latch.h"
#include "server/jobs/child_process.h"
#include "server/jobs/job_store.h"

namespace maneuver::jobs {

// Renews each lease every eighth of its LeaseTime. Kills a job whose lease was not renewed for two
// thirds of that time, even while the store hangs, or whose lease has ended: no process of the job
// is left when another worker may begin. Safe to use from any thread.
class LeaseKeeper {
 public:
  using Time = std::chrono::steady_clock::time_point;

  //   store: must outlive this object, and have a LeaseTime
  //   beat: called after each round of renewals, on a thread of this object
  //   now: the clock that decides whether a lease was renewed in time
  LeaseKeeper(JobStore& store, std::function<void()> beat,
              std::function<Time()> now = std::chrono::steady_clock::now);
  ~LeaseKeeper();
  LeaseKeeper(const LeaseKeeper&) = delete;
  LeaseKeeper& operator=(const LeaseKeeper&) = delete;

  // Keeps a lease until Release. Stops `run` with kCancelled once a cancellation is requested in
  // the store.
  //   since: a time by `now` before the job was claimed
  void Keep(const JobLease& lease, std::shared_ptr<StopRequest> run, Time since);
  // Stops keeping a job's lease.
  void Release(const std::string& job);

 private:
  struct Kept {
    JobLease lease;
    std::shared_ptr<StopRequest> run;
    Time renewed_at;
  };

  void Renew();
  void RenewOne(const Kept& kept);
  void Guard();

  JobStore& store_;
  const std::chrono::milliseconds lease_time_;
  const std::function<void()> beat_;
  const std::function<Time()> now_;
  Mutex mutex_;
  std::map<std::string, Kept> kept_ ABSL_GUARDED_BY(mutex_);  // by job
  StopLatch stop_;
  std::thread renewer_;
  std::thread guard_;  // never waits for the store
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_LEASE_KEEPER_H_
