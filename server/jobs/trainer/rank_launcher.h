// Starts several processes of this program that learn one model together, on this machine.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_

#include <string>
#include <vector>

namespace maneuver::trainer {

// Runs `arguments` once for each of 0 .. ranks - 1, with the variables of torchrun
// (model/learning/ranks/rank_place.h), and serves their store on loopback. Passes SIGTERM and
// SIGINT on to all of them. If one rank fails, the others have some seconds to end too. The ranks
// end with this process, however it ends.
//
// Returns the exit status for this process: 0 if all ranks succeeded, the exit status of the rank
// that failed, or kRankLost if a rank was killed. The last line on standard error then names that
// rank.
//   arguments: [0] is the name of the program
int RunRanks(int ranks, const std::vector<std::string>& arguments);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_
