// Tells the other servers that share a store that this one lives, and what it does.

#ifndef MANEUVER_SERVER_JOBS_REPLICA_REPORT_H_
#define MANEUVER_SERVER_JOBS_REPLICA_REPORT_H_

#include <functional>
#include <thread>

#include "locks/stop_latch.h"
#include "server/jobs/replica_registry.h"

namespace maneuver::jobs {

// Reports on a thread of its own, within a second of a change and at least every 3 s.
class ReplicaReport {
 public:
  //   registry: must outlive this object
  //   replica: called about once a second, from the object's thread
  ReplicaReport(ReplicaRegistry& registry, std::function<v1::Replica()> replica);
  // Takes the server off the list, if the store can be reached.
  ~ReplicaReport();
  ReplicaReport(const ReplicaReport&) = delete;
  ReplicaReport& operator=(const ReplicaReport&) = delete;

 private:
  void Run();

  ReplicaRegistry& registry_;
  const std::function<v1::Replica()> replica_;
  StopLatch stop_;
  std::thread thread_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_REPLICA_REPORT_H_
