// SIGTERM and SIGINT ask a run to stop.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_
#define MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_

#include "absl/status/status.h"

namespace maneuver::trainer {

// From now on SIGTERM and SIGINT are remembered; a second one ends the process at once.
void InstallStopSignals();

// Whether one came.
bool StopRequested();

// The exit status for how a run ended, and its last line on standard error if it did not end well.
int ExitStatus(const absl::Status& status);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_STOP_SIGNAL_H_
