// Handles SIGTERM and SIGINT, which ask a run to stop.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_
#define MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_

#include "absl/status/status.h"

namespace maneuver::trainer {

// Installs the handlers. They remember a signal; a second one of the same kind ends the process at
// once.
void InstallStopSignals();

// Returns whether a signal came.
bool StopRequested();

// Returns the exit status for the end of a run: a TrainerExit, or 128 + the signal if the run was
// CANCELLED by one. If the run failed, prints why as the last line on standard error.
int ExitStatus(const absl::Status& status);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_
