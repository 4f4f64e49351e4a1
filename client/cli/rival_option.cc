#include "client/cli/rival_option.h"

#include <string_view>

#include "absl/strings/str_cat.h"
#include "model/evaluation/rival_requirements.h"

namespace maneuver::cli {
namespace {

constexpr std::string_view kEveryStratum = "@strata";

v1::RivalRequirement ParseOne(std::string_view text, v1::RivalStandard standard) {
  v1::RivalRequirement requirement;
  requirement.set_standard(standard);
  requirement.set_scope(v1::RIVAL_SCOPE_ALL_EXAMPLES);
  if (text.ends_with(kEveryStratum)) {
    requirement.set_scope(v1::RIVAL_SCOPE_EVERY_STRATUM);
    text.remove_suffix(kEveryStratum.size());
  }
  const size_t colon = text.find(':');
  requirement.set_rival(std::string(text.substr(0, colon)));
  if (colon != text.npos) requirement.set_metric(std::string(text.substr(colon + 1)));
  return requirement;
}

}  // namespace

absl::Status ParseRequirements(
    const std::vector<std::string>& texts, v1::RivalStandard standard, const std::string& flag,
    google::protobuf::RepeatedPtrField<v1::RivalRequirement>* requirements) {
  for (const std::string& text : texts) {
    v1::RivalRequirement requirement = ParseOne(text, standard);
    std::vector<std::string> rivals = {requirement.rival()};
    if (requirement.rival() == "baselines") rivals = {"covernet", "multipath"};
    for (const std::string& rival : rivals) {
      requirement.set_rival(rival);
      const evaluation::RequirementFault fault = evaluation::CheckRequirement(requirement);
      if (!fault.field.empty()) {
        const std::string& wrong =
            fault.field == "metric" ? requirement.metric() : requirement.rival();
        return absl::InvalidArgumentError(
            absl::StrCat(flag, " ", text, ": ", wrong, " ", fault.description));
      }
      *requirements->Add() = requirement;
    }
  }
  return absl::OkStatus();
}

}  // namespace maneuver::cli
