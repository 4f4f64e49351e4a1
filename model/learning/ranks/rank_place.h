// Finds which of several processes this one is. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_RANKS_RANK_PLACE_H_
#define MANEUVER_MODEL_LEARNING_RANKS_RANK_PLACE_H_

#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace maneuver::learning {

// The place of a process among those that learn one model together, its ranks.
struct RankPlace {
  int rank = 0;         // 0 .. ranks - 1
  int ranks = 1;        // a power of two
  int local_rank = 0;   // among those on this machine
  int local_ranks = 0;  // on this machine; 0: unknown
  // Where the store is that the ranks meet at, a host name or an address, and its TCP port.
  std::string host;
  int port = 0;
  // True: rank 0 serves the store. False: the launcher of the ranks does.
  bool serves_store = true;
  // Tells the starts of the same ranks apart where a store outlives them (torchrun).
  std::string attempt;
};

// Reads a variable of the environment; nothing if it is not set.
using EnvironmentReader = std::function<std::optional<std::string>(const std::string& name)>;

std::optional<std::string> ReadEnvironment(const std::string& name);

// Returns the place that the environment states. The first of these that is set decides:
//   torchrun    RANK and WORLD_SIZE; also LOCAL_RANK, LOCAL_WORLD_SIZE,
//               TORCHELASTIC_USE_AGENT_STORE and TORCHELASTIC_RESTART_COUNT
//   Slurm       SLURM_PROCID, SLURM_NTASKS and SLURM_STEP_ID, which srun sets for the tasks of a
//               step; also SLURM_LOCALID
//   Kubernetes  JOB_COMPLETION_INDEX of an Indexed Job, and WORLD_SIZE of its manifest
//   Open MPI    OMPI_COMM_WORLD_RANK and OMPI_COMM_WORLD_SIZE; also OMPI_COMM_WORLD_LOCAL_RANK and
//               OMPI_COMM_WORLD_LOCAL_SIZE
// The store is at MASTER_ADDR:MASTER_PORT. Without MASTER_ADDR, a Slurm step uses its first node,
// and ranks that are all on this machine use 127.0.0.1. Without MASTER_PORT, the port is 29500, and
// in Slurm one that follows from the job's number, since jobs share nodes.
// Returns nothing if none is set: the process learns alone.
// INVALID_ARGUMENT if a variable is missing or has no such value; the message names it.
absl::StatusOr<std::optional<RankPlace>> FindRankPlace(const EnvironmentReader& read);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RANKS_RANK_PLACE_H_
