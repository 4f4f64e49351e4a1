// Where jobs and their progress are kept between runs of the server.

#ifndef MANEUVER_SERVER_JOBS_JOB_STORE_H_
#define MANEUVER_SERVER_JOBS_JOB_STORE_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::jobs {

// A page of jobs.
struct JobPage {
  std::vector<v1::Job> jobs;
  std::string next_page_token;  // empty on the last page
};

// A job by the request_id that it was asked for with.
struct RequestedJob {
  v1::Job job;
  std::string request_digest;
};

// The right of one attempt at a job to write about it while it is RUNNING. Once the lease ended,
// writes that name it change nothing.
struct JobLease {
  std::string job;    // jobs/{job}
  int64_t fence = 0;  // greater than that of every earlier lease that the store object gave
};

struct ClaimedJob {
  v1::Job job;  // RUNNING
  JobLease lease;
};

// Changes a job within a call to the store. The call and the change are durable together. Must not
// call the store. May run even if the store then fails to write the job.
using JobEdit = std::function<void(v1::Job&)>;

// What a call changed is durable once it returned OK; an error left all as it was. Jobs are named
// as Job.name, jobs/{job}. Safe to use from any thread. Errors: NOT_FOUND for an unknown job,
// RESOURCE_EXHAUSTED for a full disk, UNAVAILABLE or DATA_LOSS for what else can befall a store.
//
// A RUNNING job has at most one lease. Only the holder adds progress or ends the run.
class JobStore {
 public:
  virtual ~JobStore() = default;

  // Keeps a new job, PENDING and with a name of its own. ALREADY_EXISTS if there is a job with this
  // name or this request_id (empty: none).
  //   request_digest: tells one request from another that bears the same request_id.
  virtual absl::Status Add(const v1::Job& job, const std::string& request_id,
                           const std::string& request_digest) = 0;

  // `progress` of the jobs that are returned is their latest event.
  virtual absl::StatusOr<v1::Job> Get(const std::string& name) = 0;
  virtual absl::StatusOr<std::optional<RequestedJob>> FindRequest(
      const std::string& request_id) = 0;
  // Newest first. INVALID_ARGUMENT for a token that is none of ours.
  //   page_size: 1 or more.
  virtual absl::StatusOr<JobPage> List(int page_size, const std::string& page_token) = 0;
  // In the order in which pending jobs run: the highest priority first, then the oldest; all of
  // them, or the first so many.
  virtual absl::StatusOr<std::vector<v1::Job>> ListInState(v1::JobState state,
                                                           std::optional<int> limit) = 0;
  virtual absl::StatusOr<int64_t> CountInState(v1::JobState state) = 0;

  // Replaces a job that is in state `from` by one that is in another. FAILED_PRECONDITION if it is
  // in another state by now, if CanMove forbids the step, or if either state is RUNNING (Claim and
  // Finish). Of two callers who move the same job, one wins.
  virtual absl::Status Move(v1::JobState from, const v1::Job& job) = 0;

  // Makes the first of the PENDING jobs RUNNING, in the order of ListInState, and gives a lease.
  // `begin` changes the job as it starts. Returns nothing if no job is PENDING.
  virtual absl::StatusOr<std::optional<ClaimedJob>> Claim(const JobEdit& begin) = 0;
  // Ends a lease. `end` changes the job as it is stored and moves it from RUNNING to another state.
  // ABORTED if the lease has ended, FAILED_PRECONDITION if CanMove forbids the step.
  virtual absl::Status Finish(const JobLease& lease, const JobEdit& end) = 0;
  // Moves the RUNNING jobs without a lease, those of an earlier process, to another state by `end`.
  // Returns them as they are stored. After an error, some may have been moved.
  virtual absl::StatusOr<std::vector<v1::Job>> TakeAbandoned(const JobEdit& end) = 0;
  // Sets cancel_requested of a RUNNING job, with or without a lease, and returns the job.
  // FAILED_PRECONDITION if it is in another state.
  virtual absl::StatusOr<v1::Job> RequestCancel(const std::string& name) = 0;

  // Appends an event. Its sequence must be greater than that of the last. ABORTED if the lease has
  // ended.
  virtual absl::Status AddProgress(const JobLease& lease, const v1::JobProgress& progress) = 0;
  // Events with a greater sequence, in order, at most `limit`. None for an unknown job.
  virtual absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                                    int64_t after_sequence,
                                                                    int limit) = 0;

  // Forgets a job and its progress. FAILED_PRECONDITION unless it has ended.
  virtual absl::Status Delete(const std::string& name) = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STORE_H_
