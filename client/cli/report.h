// Writes reports to files: a page for a browser, and learning curves for other programs.

#ifndef MANEUVER_CLIENT_CLI_REPORT_H_
#define MANEUVER_CLIENT_CLI_REPORT_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::cli {

// The requested files.
struct ReportFiles {
  std::optional<std::string> page;         // HTML
  std::optional<std::string> curves;       // CSV
  std::optional<std::string> tensorboard;  // folder

  bool any() const { return page || curves || tensorboard; }
};

// Adds --curves and --tensorboard.
void AddCurveOptions(Command& command, ReportFiles* files);

// Checks that the files can be created, and creates the folder of `tensorboard`, before anything is
// computed. FAILED_PRECONDITION names the path and the reason.
absl::Status PrepareReport(const ReportFiles& files);

// Writes the requested files about what the job trained or measured. Returns an ExitCode.
int WriteJobReport(const std::string& job, const ReportFiles& files, Environment& environment);

// Does the same as WriteJobReport for a job that WatchToEnd has watched. If the job is still
// running, prints how to get the report later.
int WriteReportOfWatched(const std::string& job, const ReportFiles& files,
                         Environment& environment);

void AddJobReport(Command& group, Environment& environment);
void AddModelReport(Command& group, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_REPORT_H_
