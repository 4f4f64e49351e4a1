// What a job needs of the server that runs it, and what a server has for its jobs.

#ifndef MANEUVER_SERVER_JOBS_WORKER_CAPACITY_H_
#define MANEUVER_SERVER_JOBS_WORKER_CAPACITY_H_

#include <cstdint>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::jobs {

struct JobNeeds {
  std::string device = "cpu";
  int64_t ranks = 1;         // processes that learn together
  int64_t memory_bytes = 0;  // of all ranks; 0: not known
};

// Returns the needs of a job with complete settings: its memory is that of Job.memory for each
// rank.
JobNeeds NeedsOf(const v1::Job& job);

struct WorkerCapacity {
  std::set<std::string> devices = {"cpu"};
  int64_t ranks = std::numeric_limits<int64_t>::max();
  int64_t memory_bytes = std::numeric_limits<int64_t>::max();  // for one job

  bool CanRun(const JobNeeds& needs) const;
  friend bool operator==(const WorkerCapacity&, const WorkerCapacity&) = default;
};

// Returns why none of the servers can run a job, for people; empty if one of them can.
std::string WhyNobodyRuns(const JobNeeds& needs, const std::vector<WorkerCapacity>& workers);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_WORKER_CAPACITY_H_
