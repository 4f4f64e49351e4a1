#include "client/cli/scenario_files.h"

#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/json_files.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"

namespace maneuver::cli {

absl::StatusOr<std::vector<v1::Scenario>> ReadScenarios(const std::vector<std::string>& files,
                                                        Environment& environment) {
  std::vector<v1::Scenario> scenarios(files.size());
  for (size_t i = 0; i < files.size(); ++i) {
    absl::Status status = ReadJson(files[i], environment, &scenarios[i]);
    if (!status.ok()) return status;
    if (scenarios[i].target_ids().empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(files[i],
                       " names no target; list agents in \"targetIds\", or extract the scene with "
                       "maneuver scenario extract --target ID"));
    }
  }
  return scenarios;
}

std::string TargetName(const std::string& scenario_id, int64_t target_id) {
  return absl::StrCat(scenario_id, " target ", target_id);
}

void ReportItemError(const std::string& item, const v1::Status& error, Environment& environment) {
  environment.errors << "maneuver: " << Printable(item) << ": "
                     << PrintableLines(environment.Explain(client::ToStatus(error))) << "\n";
}

void ReportWarnings(const std::string& item, const SceneWarnings& warnings,
                    Environment& environment) {
  for (const v1::SceneWarning& warning : warnings) {
    environment.err << "maneuver: warning: " << Printable(item) << ": "
                    << Printable(warning.field()) << ": " << Printable(warning.description())
                    << "\n";
  }
}

void AddStrictOption(Command& command, bool* strict) {
  command.Flag(
      "--strict", strict,
      "Refuse scenes that look wrong, such as with degrees for radians, instead of answering them "
      "with warnings");
}

}  // namespace maneuver::cli
