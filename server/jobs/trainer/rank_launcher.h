// Starts several processes of this program that learn one model together, on this machine.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_

#include <string>
#include <vector>

namespace maneuver::trainer {

// Runs `arguments` once for each of 0 .. ranks - 1, with the variables of torchrun
// (model/learning/ranks/rank_place.h), and serves their store on loopback. Passes SIGTERM and SIGINT
// on to all of them. If one ends otherwise than by success, the others have some seconds to end
// too. Returns the exit status for this process: 0 if all succeeded; else that of the rank that
// failed; kRankLost if one was killed, and says which as the last line on standard error. The ranks
// end with this process, however it ends.
//   arguments: [0] is the name of the program
int RunRanks(int ranks, const std::vector<std::string>& arguments);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RANK_LAUNCHER_H_
