#ifndef MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
#define MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_

#include <filesystem>
#include <string>

#include "tests/integration/server_process.h"

namespace maneuver::integration {

// What GET http://ADDRESS/PATH of a server is answered, with its head.
std::string HttpGet(const ServerProcess& server, const std::string& path);

// What http://ADDRESS/metrics of a server shows.
std::string MetricsPage(const ServerProcess& server);

// The value of a series of it, `name{label="value"}`; -1 if it is not there.
double ValueOf(const std::string& page, const std::string& series);

// Names, types, help and labels of a page in alphabetical order, without what changes: the numbers,
// the bounds of buckets, the version and the model; methods by one of them.
//   prefix: of the names that are wanted
std::string ShapeOf(const std::string& page, const std::string& prefix = "");

// Fails, and writes `shape` to `seen`, if it is not what `golden` holds.
void ExpectShape(const std::string& shape, const std::filesystem::path& golden,
                 const std::filesystem::path& seen);

// Whether Prometheus' own checker is installed, and whether it finds nothing wrong with a page,
// which is written to `file`.
bool HasPromtool();
void ExpectPromtoolIsContent(const std::string& page, const std::filesystem::path& file);

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
