// Scenarios without what lies after their prediction time.

#ifndef MANEUVER_CLIENT_OBSERVED_SCENARIO_H_
#define MANEUVER_CLIENT_OBSERVED_SCENARIO_H_

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::client {

// Removes the states and signal readings after prediction_time (a microsecond is allowed for
// rounding). Predictions never look at them, so that a request is smaller without. Agents that are
// seen only later go as well, unless they are targets: those stay for the server to name.
void StripFuture(v1::Scenario* scenario);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_OBSERVED_SCENARIO_H_
