// Reports as files: a page for a browser, and learning curves for other programs.

#ifndef MANEUVER_CLIENT_CLI_REPORT_H_
#define MANEUVER_CLIENT_CLI_REPORT_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

// Which files are asked for.
struct ReportFiles {
  std::optional<std::string> page;         // HTML
  std::optional<std::string> curves;       // CSV
  std::optional<std::string> tensorboard;  // folder

  bool any() const { return page || curves || tensorboard; }
};

// Adds --curves and --tensorboard.
void AddCurveOptions(Command& command, ReportFiles* files);

// Sees whether the files can be made, so that nothing is computed in vain. FAILED_PRECONDITION
// names the path and the reason.
absl::Status PrepareReport(const ReportFiles& files);

// Writes the files that are asked for, of what the job made or measured; returns an ExitCode.
int WriteJobReport(const std::string& job, const ReportFiles& files, Environment& environment);

// The same of the job that WatchToEnd has watched, unless it goes on: then err says how to have the
// report later.
int WriteReportOfWatched(const std::string& job, const ReportFiles& files,
                         Environment& environment);

void AddJobReport(Command& group, Environment& environment);
void AddModelReport(Command& group, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_REPORT_H_
