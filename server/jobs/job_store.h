// Where jobs and their progress are kept between runs of the server.

#ifndef MANEUVER_SERVER_JOBS_JOB_STORE_H_
#define MANEUVER_SERVER_JOBS_JOB_STORE_H_

#include <cstdint>
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

// What a call changed is durable once it returned OK; an error left all as it was. Jobs are named
// as Job.name, jobs/{job}. Safe to use from any thread. Errors: NOT_FOUND for an unknown job,
// RESOURCE_EXHAUSTED for a full disk, UNAVAILABLE or DATA_LOSS for what else can befall a store.
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
  // in another state by now, or if CanMove forbids the step: of two who move the same job, one
  // wins.
  virtual absl::Status Move(v1::JobState from, const v1::Job& job) = 0;

  // Replaces a job by one in the same state. FAILED_PRECONDITION if it is in another by now.
  virtual absl::Status Update(const v1::Job& job) = 0;

  // Appends an event. Its sequence must be greater than that of the last.
  virtual absl::Status AddProgress(const std::string& name, const v1::JobProgress& progress) = 0;
  // Events with a greater sequence, in order, at most `limit`. None for an unknown job.
  virtual absl::StatusOr<std::vector<v1::JobProgress>> ListProgress(const std::string& name,
                                                                    int64_t after_sequence,
                                                                    int limit) = 0;

  // Forgets a job and its progress. FAILED_PRECONDITION unless it has ended.
  virtual absl::Status Delete(const std::string& name) = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_STORE_H_
