// Stores jobs and their progress, so that they survive a restart of the server.

#ifndef MANEUVER_SERVER_JOBS_JOB_STORE_H_
#define MANEUVER_SERVER_JOBS_JOB_STORE_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/worker_capacity.h"

namespace maneuver::jobs {

// A job whose row is damaged.
struct DamagedJob {
  std::string name;    // jobs/{job}; empty if that is damaged, too
  absl::Status error;  // DATA_LOSS; the message names the job
  size_t newer = 0;    // how many jobs of its page are newer
};

// A page of jobs.
struct JobPage {
  std::vector<v1::Job> jobs;
  std::string next_page_token;  // empty on the last page
  // The jobs that `jobs` leaves out, newest first.
  std::vector<DamagedJob> damaged = {};
};

// A job, found by the request_id of the request that created it.
struct RequestedJob {
  v1::Job job;
  std::string request_digest;
};

// The right of one attempt to write about a job while the job is RUNNING. After the lease has
// ended, writes with it change nothing.
struct JobLease {
  std::string job;    // jobs/{job}
  int64_t fence = 0;  // greater than that of every earlier lease whose holder may still be there
};

struct ClaimedJob {
  v1::Job job;  // RUNNING
  JobLease lease;
};

// How far a job is. While it stays the same, there is no news of the job.
struct JobPosition {
  std::string job;
  v1::JobState state = v1::JOB_STATE_UNSPECIFIED;
  int64_t last_sequence = 0;  // of its latest event; 0: none

  bool operator==(const JobPosition&) const = default;
};

// Changes a job within a call to the store: the call's own change and this one become durable
// together. It must not call the store. It may run even if the store then fails to write the job.
using JobEdit = std::function<void(v1::Job&)>;

// When a call returns OK, its change is durable. When it returns an error, nothing has changed: if
// a lost connection left that open, the store takes the change back before this server's next call.
// Only Delete and Renew may have happened all the same after UNAVAILABLE.
//
// Jobs are named as Job.name: jobs/{job}. Thread-safe. Errors of every method: NOT_FOUND for an
// unknown job, RESOURCE_EXHAUSTED for a full disk, UNAVAILABLE if the store cannot be reached or is
// busy, DATA_LOSS if it is damaged.
//
// A RUNNING job has at most one lease. Only the holder of the lease adds progress or ends the job.
// In a store that several servers share, a lease ends unless it is renewed.
class JobStore {
 public:
  virtual ~JobStore() = default;

  // Returns how long after its Claim or Renew a lease may be taken from its holder. Nothing if
  // leases last as long as this object, which no other server uses.
  virtual std::optional<std::chrono::milliseconds> LeaseTime() const = 0;

  // Stores a new PENDING job. ALREADY_EXISTS if a job has this name or this request_id.
  //   request_id: empty if the caller gave none
  //   request_digest: distinguishes different requests with the same request_id
  virtual absl::Status Add(const v1::Job& job, const std::string& request_id,
                           const std::string& request_digest) = 0;

  // Returns a job; its `progress` is its latest event.
  virtual absl::StatusOr<v1::Job> Get(const std::string& name) = 0;
  // Returns the job that a request created, if there is one.
  virtual absl::StatusOr<std::optional<RequestedJob>> FindRequest(
      const std::string& request_id) = 0;
  // Returns a page of jobs, newest first; damaged ones apart. INVALID_ARGUMENT for a token that
  // List did not return.
  //   page_size: 1 or more, of sound and damaged jobs together
  virtual absl::StatusOr<JobPage> List(int page_size, const std::string& page_token) = 0;
  // Returns the jobs in a state, at most `limit`, in the order in which pending jobs start: the
  // highest priority first, among equals the oldest. DATA_LOSS if one of them is damaged.
  virtual absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                           std::optional<int> limit) = 0;
  virtual absl::StatusOr<int64_t> CountInState(v1::JobState state) = 0;

  // Replaces a job in state `from` by `job`, which is in another state. FAILED_PRECONDITION if the
  // stored job is no longer in `from`, if CanMove forbids the step, or if either state is RUNNING
  // (use Claim and Finish). When two callers move the same job, exactly one succeeds.
  virtual absl::Status Move(v1::JobState from, const v1::Job& job) = 0;

  // Makes the first PENDING job, in the order of ListInState, RUNNING and returns it with a lease.
  // `begin` changes the job as it starts. Returns nothing if no job is PENDING. Passes over jobs
  // that are damaged, and logs each of them once.
  //   worker: leaves jobs out that this server cannot run; nothing: takes any
  virtual absl::StatusOr<std::optional<ClaimedJob>> Claim(
      const JobEdit& begin, const std::optional<WorkerCapacity>& worker) = 0;
  absl::StatusOr<std::optional<ClaimedJob>> Claim(const JobEdit& begin) {
    return Claim(begin, std::nullopt);
  }
  // Renews a lease. Returns whether the job is to be cancelled. ABORTED if the lease has ended.
  virtual absl::StatusOr<bool> Renew(const JobLease& lease) = 0;
  // Ends a lease. `end` changes the stored job and moves it from RUNNING to another state.
  // ABORTED if the lease has ended, FAILED_PRECONDITION if CanMove forbids the step.
  virtual absl::Status Finish(const JobLease& lease, const JobEdit& end) = 0;
  // Moves RUNNING jobs whose lease has ended, because its holder is gone or did not renew it, to
  // another state by `end`. Returns them as they are now stored. Passes over damaged jobs as Claim
  // does. After an error, some may have been moved.
  virtual absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const JobEdit& end) = 0;
  // Sets cancel_requested of a RUNNING job, with or without a lease, and returns the job. The
  // holder of the lease learns of it by Renew. FAILED_PRECONDITION if it is in another state.
  virtual absl::StatusOr<v1::Job> RequestCancel(const std::string& name) = 0;

  // Appends an event. Its sequence must be greater than the last event's. ABORTED if the lease has
  // ended.
  virtual absl::Status AddProgress(const JobLease& lease, const v1::JobProgress& progress) = 0;
  // Returns the events after `after_sequence`, in order, at most `limit`. An unknown job has none.
  virtual absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                                    int64_t after_sequence,
                                                                    int limit) = 0;

  // Returns how far each of `names` is, in any order, at the cost of one query. Leaves out unknown
  // jobs.
  virtual absl::StatusOr<std::vector<JobPosition>> ListPositions(
      const std::vector<std::string>& names) = 0;

  // Deletes a job and its progress. FAILED_PRECONDITION unless it has ended.
  virtual absl::Status Delete(const std::string& name) = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STORE_H_
