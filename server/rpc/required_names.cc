#include "server/rpc/required_names.h"

#include <map>
#include <set>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {

absl::Status CheckRequiredNames(const ActionNameList& required, std::span<const std::string> names,
                                const security::ModelVersionName& version) {
  constexpr size_t kMostBytes = 256;  // 64 characters in UTF-8
  const std::set<std::string_view> there(names.begin(), names.end());
  std::set<std::string> missing;
  for (int i = 0; i < required.size(); ++i) {
    if (required[i].size() > kMostBytes) {
      return errors::InvalidField(absl::StrCat("required_action_names[", i, "]"),
                                  "longer than 64 characters, which no name can be");
    }
    if (!there.contains(required[i])) missing.insert(required[i]);
  }
  if (missing.empty()) return absl::OkStatus();
  std::map<std::string, std::string> metadata = {{"model_version", version.ToString()}};
  for (const std::string& name : missing) {
    if (metadata.size() > errors::kMaxListedViolations) break;
    metadata.emplace(absl::StrCat("action_name_", metadata.size() - 1), name);
  }
  return errors::WithReason(
      absl::FailedPreconditionError(absl::StrCat(
          "required_action_names: ", version.ToString(), " has no action named \"",
          *missing.begin(), "\"",
          missing.size() > 1 ? absl::StrCat(" (and ", missing.size() - 1, " more)") : "",
          "; see its actions with GetActionSet")),
      "ACTION_NAME_GONE", metadata);
}

}  // namespace maneuver::rpc
