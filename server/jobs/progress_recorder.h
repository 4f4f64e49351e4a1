// Stores the reports of a trainer as events of its job.

#ifndef MANEUVER_SERVER_JOBS_PROGRESS_RECORDER_H_
#define MANEUVER_SERVER_JOBS_PROGRESS_RECORDER_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/time/time.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_store.h"
#include "server/jobs/job_watch.h"

namespace maneuver::jobs {

// Numbers the events of one job, stores them and tells its watchers. The end of an epoch and the
// beginning of a phase always become events. Any other report within 200 ms of the last event
// waits, and the next report replaces it. An event that cannot be stored is lost, with a line in
// the log. Not thread-safe.
class ProgressRecorder {
 public:
  //   job: contains its latest event and counts this process among its attempts
  //   lease: the lease of the job; events of a worker whose lease has ended are dropped
  //   show: called with every event just before it is stored; may be empty
  ProgressRecorder(JobStore& store, JobNews& news, const v1::Job& job, JobLease lease,
                   std::function<absl::Time()> now,
                   std::function<void(const v1::JobProgress&)> show = nullptr);

  // Maps the trainer's fractions from now on, 0 to 1, to the part of the job from `begin` to `end`.
  // At first the part is the whole job.
  void SetPart(double begin, double end);
  // Divides the rest of the job into `runs` equal parts, of which the trainer now begins the first.
  // Maps its fractions to that part. The time left that it reports then counts all parts. Until it
  // reports one, the time left that was recorded last goes down with the clock.
  void SetRest(int runs);
  // Records one line of the trainer: a JobProgress as proto3 JSON. Logs and skips any other line.
  void Record(const std::string& line);
  // Stores a waiting event once it has waited 200 ms. Call it now and then.
  void Tick();
  // Stores the event that waits, if there is one.
  void Flush();

 private:
  void Store(v1::JobProgress progress);
  // Returns whether progress may be stored again.
  bool IsDue() const;

  JobStore& store_;
  JobNews& news_;
  const JobLease lease_;
  const int attempt_;
  const std::function<absl::Time()> now_;
  const std::function<void(const v1::JobProgress&)> show_;
  int64_t last_sequence_;
  absl::Time last_time_ = absl::InfinitePast();
  std::string last_phase_;
  double last_fraction_;  // of the job
  double part_begin_ = 0.0;
  double part_end_ = 1.0;
  int runs_after_ = 0;                 // parts that follow the present one (SetRest)
  absl::Time run_begun_at_{};          // when the present part began, if runs_after_ > 0
  std::optional<absl::Time> ends_at_;  // when the job ends, by the latest time left
  std::optional<v1::JobProgress> waiting_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROGRESS_RECORDER_H_
