#include "client/cli/scenario_files.h"

#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/json_files.h"
#include "client/cli/text_format.h"
#include "client/error_details.h"

namespace maneuver::cli {
namespace {

// "ITEM: ". Nothing for a scene without a name, or with one that is too long to be accepted: the
// field paths of its errors name it.
std::string Prefix(const std::string& item) {
  constexpr size_t kTooLong = 256;
  return item.empty() || item.size() > kTooLong ? "" : absl::StrCat(Printable(item), ": ");
}

}  // namespace

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
  return absl::StrCat(scenario_id, scenario_id.empty() ? "" : " ", "target ", target_id);
}

void ReportItemError(const std::string& item, const v1::Status& error, Environment& environment) {
  if (environment.json()) {
    const absl::Status status = client::ToStatus(error);
    environment.PrintError(absl::StatusCodeToString(status.code()),
                           client::ErrorDetailsOf(status).reason,
                           absl::StrCat(Prefix(item), Environment::Describe(status)));
    return;
  }
  environment.errors << "maneuver: " << Prefix(item)
                     << PrintableLines(Environment::Describe(client::ToStatus(error))) << "\n";
}

void ReportWarnings(const std::string& item, const SceneWarnings& warnings,
                    Environment& environment) {
  if (environment.json()) return;  // the answer has them
  for (const v1::SceneWarning& warning : warnings) {
    environment.err << "maneuver: warning: " << Prefix(item) << Printable(warning.field()) << ": "
                    << Printable(warning.description()) << "\n";
  }
}

void AddStrictOption(Command& command, bool* strict) {
  command.Flag(
      "--strict", strict,
      "Refuse scenes that look wrong, such as with degrees for radians, instead of answering them "
      "with warnings");
}

}  // namespace maneuver::cli
