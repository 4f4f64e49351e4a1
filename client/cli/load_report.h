// Prints what `maneuver load` measured, for people and for scripts.

#ifndef MANEUVER_CLIENT_CLI_LOAD_REPORT_H_
#define MANEUVER_CLIENT_CLI_LOAD_REPORT_H_

#include <optional>
#include <string>
#include <vector>

#include "client/load/load_run.h"
#include "client/load/server_watch.h"

namespace maneuver::cli {

struct LoadStep {
  std::string name;  // "25 %", "200/s", "32 callers"
  load::LoadPlan plan;
  load::Tally tally;
  std::optional<load::ServerChange> server = {};  // if its metrics were read
};

struct LoadReport {
  std::string server;
  int requests = 0;           // different ones
  double mean_targets = 0.0;  // of a request
  double mean_bytes = 0.0;
  int connections = 0;
  std::optional<double> capacity = {};  // calls a second, if it was measured
  std::vector<LoadStep> steps = {};
  bool interrupted = false;
};

enum class TableStyle { kText, kColorText, kMarkdown };

// Returns a table with a line for each step: what callers measured, then what the server measured.
// Remarks follow below.
std::string LoadReportText(const LoadReport& report, TableStyle style);

// Returns the whole report as JSON, latencies in milliseconds.
std::string LoadReportJson(const LoadReport& report);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_LOAD_REPORT_H_
