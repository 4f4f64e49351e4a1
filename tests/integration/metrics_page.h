#ifndef MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
#define MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_

#include <filesystem>
#include <string>

#include "tests/integration/server_process.h"

namespace maneuver::integration {

// Returns the server's answer to GET http://ADDRESS/PATH, with its headers.
std::string HttpGet(const ServerProcess& server, const std::string& path);

// Returns the page http://ADDRESS/metrics of a server.
std::string MetricsPage(const ServerProcess& server);

// Returns the value of a series of the page, `name{label="value"}`; -1 if it is not there.
double ValueOf(const std::string& page, const std::string& series);

// Returns names, types, help and labels of a page in alphabetical order. Leaves out everything that
// varies: numbers, bounds of buckets, the version, the model and the speeds that were met. Shows
// one method in place of all.
//   prefix: of the names to return
std::string ShapeOf(const std::string& page, const std::string& prefix = "");

// Fails the test and writes `shape` to `seen` if it differs from the content of `golden`.
void ExpectShape(const std::string& shape, const std::filesystem::path& golden,
                 const std::filesystem::path& seen);

// Returns whether Prometheus' own checker is installed.
bool HasPromtool();
// Writes a page to `file` and expects that the checker accepts it.
void ExpectPromtoolIsContent(const std::string& page, const std::filesystem::path& file);

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_METRICS_PAGE_H_
