// The list of the servers that share a store.

#ifndef MANEUVER_SERVER_JOBS_REPLICA_REGISTRY_H_
#define MANEUVER_SERVER_JOBS_REPLICA_REGISTRY_H_

#include <chrono>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/replica_service.pb.h"
#include "server/jobs/worker_capacity.h"

namespace maneuver::jobs {

// How long after its last report a server counts as live, by the store's clock.
inline constexpr std::chrono::seconds kReplicaLife{15};

// Safe to use from any thread. Errors of every method: those of the store.
class ReplicaRegistry {
 public:
  virtual ~ReplicaRegistry() = default;

  // Replaces what this server told the others before.
  virtual absl::Status Report(const v1::Replica& replica) = 0;
  // Takes this server off the list.
  virtual absl::Status Leave() = 0;
  // Returns the live servers, by name.
  virtual absl::StatusOr<std::vector<v1::Replica>> ListLive() = 0;
  // Returns what PENDING jobs need, without repetition, with how many of them need it.
  virtual absl::StatusOr<std::vector<std::pair<JobNeeds, int64_t>>> CountPendingNeeds() = 0;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_REPLICA_REGISTRY_H_
