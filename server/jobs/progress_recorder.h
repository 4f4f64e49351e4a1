// What a trainer reports, as events in the store.

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

// Numbers the events of one run, stores them and tells of them. Every end of an epoch and every new
// phase becomes an event; what comes closer than 200 ms to the event before it waits, and is
// replaced by what comes next. Not thread-safe.
class ProgressRecorder {
 public:
  //   job: with its latest event so far, and this process counted.
  //   lease: of the job; events of a worker whose lease has ended are dropped.
  //   show: called with every event that is stored.
  ProgressRecorder(JobStore& store, JobNews& news, const v1::Job& job, JobLease lease,
                   std::function<absl::Time()> now,
                   std::function<void(const v1::JobProgress&)> show = nullptr);

  // What the trainer reports from now on is this part of the job, from 0 to 1: its fraction becomes
  // one of the whole. At first it is all of it.
  void SetPart(double begin, double end);
  // One line of the trainer: a JobProgress as proto3 JSON. What is none is logged and passed over.
  void Record(const std::string& line);
  // Stores an event that waited long enough. Call it now and then.
  void Tick();
  // Stores the event that waits, if there is one.
  void Flush();

 private:
  void Store(v1::JobProgress progress);

  JobStore& store_;
  JobNews& news_;
  const JobLease lease_;
  const int attempt_;
  const std::function<absl::Time()> now_;
  const std::function<void(const v1::JobProgress&)> show_;
  int64_t last_sequence_;
  absl::Time last_time_ = absl::InfinitePast();
  std::string last_phase_;
  double part_begin_ = 0.0;
  double part_end_ = 1.0;
  std::optional<v1::JobProgress> waiting_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROGRESS_RECORDER_H_
