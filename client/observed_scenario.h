// Removes what lies after a scenario's prediction time.

#ifndef MANEUVER_CLIENT_OBSERVED_SCENARIO_H_
#define MANEUVER_CLIENT_OBSERVED_SCENARIO_H_

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::client {

// Removes the states and signal readings after prediction_time (plus a microsecond for rounding).
// Predictions never use them, so requests become smaller. Also removes agents that appear only
// later, unless they are targets: for those the server reports an error.
void StripFuture(v1::Scenario* scenario);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_OBSERVED_SCENARIO_H_
