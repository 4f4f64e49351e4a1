#include "client/cli/action_titles.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "client/cli/resource_names.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "model/evaluation/action_matching.h"

namespace maneuver::cli {
namespace {

std::string NameIn(const v1::ModelVersion& version, int action_id) {
  const auto& actions = version.manifest().actions();
  return action_id < actions.size() ? actions[action_id].display_name() : "";
}

}  // namespace

std::string TitleOf(const ActionTitles& titles, int action_id) {
  return action_id < titles.size() ? titles[action_id] : "";
}

std::vector<std::string> FetchActionNames(const std::string& model_version,
                                          Environment& environment) {
  v1::GetActionSetRequest request;
  request.set_name(model_version);
  const auto set = environment.server_client().GetActionSet(request, environment.call_options());
  std::vector<std::string> names;
  if (!set.ok()) return names;
  for (const v1::Action& action : set->actions()) names.push_back(action.display_name());
  return names;
}

void AddRequireNameOption(Command& command, std::vector<std::string>* names) {
  command.Option(
      "--require-name", names,
      "Fail unless an action of the version that answers has this name; may be repeated");
}

std::string ActionMappingText(const v1::ModelVersion& before, const v1::ModelVersion& after,
                              bool color) {
  const auto matching = evaluation::MatchActions(before.manifest(), after.manifest());
  if (!matching.ok()) {
    return absl::StrCat("The actions of ", ShortName(before.name()), " and ",
                        ShortName(after.name()),
                        " cannot be matched: ", std::string(matching.status().message()), "\n");
  }
  std::vector<v1::ActionPair> pairs(matching->pairs().begin(), matching->pairs().end());
  std::ranges::sort(pairs, {}, [](const v1::ActionPair& pair) { return pair.first().action_id(); });
  Table table({{ShortName(before.name()), Align::kRight},
               {"NAME"},
               {ShortName(after.name()), Align::kRight},
               {"NAME"},
               {"APART", Align::kRight}});
  for (const v1::ActionPair& pair : pairs) {
    const int from = pair.first().action_id();
    const int to = pair.second().action_id();
    table.Add({absl::StrCat(from), NameIn(before, from), absl::StrCat(to), NameIn(after, to),
               absl::StrCat(Fixed(pair.distance(), 1), " m")});
  }
  for (const v1::MatchedAction& action : matching->unpaired_first()) {
    table.Add({absl::StrCat(action.action_id()), NameIn(before, action.action_id()), "-",
               "(no such action)", "-"});
  }
  for (const v1::MatchedAction& action : matching->unpaired_second()) {
    table.Add({"-", "(no such action)", absl::StrCat(action.action_id()),
               NameIn(after, action.action_id()), "-"});
  }
  return table.Text(color);
}

}  // namespace maneuver::cli
