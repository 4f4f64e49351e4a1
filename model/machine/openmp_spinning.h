// How long OpenMP's idle threads spin.

#ifndef MANEUVER_MODEL_MACHINE_OPENMP_SPINNING_H_
#define MANEUVER_MODEL_MACHINE_OPENMP_SPINNING_H_

namespace maneuver::machine {

// Lets idle threads spin for microseconds, in the programs that this process starts from here on.
// OpenMP's default is milliseconds: on cores that are shared, with the server above all, that costs
// several times the work. The runtime reads its limit when a program is loaded, so this process
// itself has to be started once more. Call before there are other threads: it changes the
// environment.
// Returns false if the environment already sets a limit, which stays.
bool ShortenOpenMpSpinning();

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_OPENMP_SPINNING_H_
