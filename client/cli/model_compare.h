// The command `maneuver model compare`, and the reports that it compares.

#ifndef MANEUVER_CLIENT_CLI_MODEL_COMPARE_H_
#define MANEUVER_CLIENT_CLI_MODEL_COMPARE_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/command.h"
#include "client/cli/environment.h"
#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::cli {

// Returns the evaluation reports of a version, newest first, without strata.
//   model: as in GetModelVersionRequest.name
absl::StatusOr<std::vector<v1::EvaluationReport>> ListReports(const std::string& model,
                                                              Environment& environment);

void AddModelCompare(Command& group, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_MODEL_COMPARE_H_
