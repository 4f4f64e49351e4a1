// Reads what a report shows from the server.

#ifndef MANEUVER_CLIENT_CLI_REPORT_COLLECTION_H_
#define MANEUVER_CLIENT_CLI_REPORT_COLLECTION_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/environment.h"
#include "client/report/report_data.h"

namespace maneuver::cli {

// Returns what a training job has reported so far; nothing for other jobs. Does not wait for the
// job to end.
absl::StatusOr<std::vector<report::LearningPhase>> LearningOf(const v1::Job& job,
                                                              Environment& environment);

// Returns the job that trained a version; nothing if the server does not know it any more.
//   version: models/{model}/versions/{version}
absl::StatusOr<std::optional<v1::Job>> TrainingJobOf(const std::string& version,
                                                     Environment& environment);

// Gathers what is known about a version: its actions, its evaluation on `dataset` (or its newest
// one), evaluations of at most eight other versions on the same examples, its learning curves, and
// scenes. ReportData::missing names what the server does not have. NOT_FOUND if there is no such
// version, or no evaluation on `dataset`; other errors of the calls that read these two.
//   model: as in GetModelVersionRequest.name
//   dataset: datasets/{dataset}
absl::StatusOr<report::ReportData> CollectVersion(const std::string& model,
                                                  const std::optional<std::string>& dataset,
                                                  Environment& environment);

// Gathers the same for the version that a job trained or measured. For a training without a version
// (yet), gathers its curves. INVALID_ARGUMENT for a cross-validation or a tagging;
// FAILED_PRECONDITION for an evaluation that has measured nothing.
absl::StatusOr<report::ReportData> CollectJob(const v1::Job& job, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_REPORT_COLLECTION_H_
