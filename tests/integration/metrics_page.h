#ifndef MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
#define MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_

#include <string>

#include "tests/integration/server_process.h"

namespace maneuver::testing {

// What http://ADDRESS/metrics of a server shows.
std::string MetricsPage(const ServerProcess& server);

// The value of a series of it, `name{label="value"}`; -1 if it is not there.
double ValueOf(const std::string& page, const std::string& series);

}  // namespace maneuver::testing

#endif  // MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
