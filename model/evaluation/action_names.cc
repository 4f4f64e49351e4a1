#include "model/evaluation/action_names.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/action_phrase.h"
#include "model/evaluation/generic_mean.h"

namespace maneuver::evaluation {
namespace {

std::string NumberedName(int action_id) { return absl::StrCat("action ", action_id); }

v1::AgentType MoverOf(const v1::ModelSpec& spec) {
  return spec.target_types_size() == 1 ? spec.target_types(0) : v1::AGENT_TYPE_VEHICLE;
}

ActionPhrase PhraseOf(const v1::ModelSpec& spec, const v1::Action& action,
                      const v1::ActionUse* use) {
  const std::optional<inference::Trajectory> mean = GenericMean(action);
  if (!mean || !mean->allFinite() || spec.trajectory().waypoints() == 0) {
    return {.words = NumberedName(action.action_id())};
  }
  ActionEvidence evidence{.mean = *mean,
                          .waypoint_interval = artifact::WaypointInterval(spec.trajectory()),
                          .type = MoverOf(spec)};
  if (use != nullptr) evidence.use = *use;
  return artifact::HasReference(spec) ? RelativePhrase(evidence) : PlacePhrase(evidence);
}

// The names of actions of the same words, each with its number, or with its place among them if no
// number tells them apart. None is one of `taken`.
std::vector<std::string> TellApart(const std::vector<const ActionPhrase*>& equal,
                                   std::set<std::string> taken) {
  constexpr int kMostDecimals = 2;
  std::vector<std::string> names;
  for (int decimals = 0; decimals <= kMostDecimals; ++decimals) {
    names.clear();
    std::set<std::string> all = taken;
    // "-0 m/s" says nothing.
    bool all_tell = true;
    for (const ActionPhrase* phrase : equal) {
      names.push_back(phrase->WithNumber(decimals));
      all_tell &= !phrase->with_sign || std::abs(phrase->number) >= 0.5 * std::pow(10.0, -decimals);
      all_tell &= all.insert(names.back()).second;
    }
    if (all_tell) return names;
  }
  names.clear();
  for (const ActionPhrase* phrase : equal) {
    int place = 1;
    while (!taken.insert(absl::StrCat(phrase->words, " (", place, ")")).second) ++place;
    names.push_back(absl::StrCat(phrase->words, " (", place, ")"));
  }
  return names;
}

// The derived names that are stored, unless there are none. [K]
std::vector<std::string> DerivedNames(const v1::ModelManifest& manifest) {
  std::vector<std::string> names;
  for (const v1::Action& action : manifest.actions()) {
    if (action.derived_name().empty()) return NameActions(manifest);
    names.push_back(action.derived_name());
  }
  return names;
}

}  // namespace

std::vector<std::string> NameActions(const v1::ModelManifest& manifest,
                                     std::span<const v1::ActionUse> uses) {
  std::vector<ActionPhrase> phrases;
  std::map<std::string, std::vector<size_t>> by_words;
  for (const v1::Action& action : manifest.actions()) {
    const size_t k = phrases.size();
    phrases.push_back(PhraseOf(manifest.spec(), action, k < uses.size() ? &uses[k] : nullptr));
    by_words[phrases.back().words].push_back(k);
  }
  std::vector<std::string> names(phrases.size());
  for (auto& [words, equal] : by_words) {
    // Actions that are in use get the short names, whatever the others do.
    const auto others = std::stable_partition(equal.begin(), equal.end(), [&](size_t k) {
      return manifest.actions(static_cast<int>(k)).effective();
    });
    const std::span<const size_t> groups[] = {{equal.begin(), others}, {others, equal.end()}};
    std::set<std::string> taken;
    for (const std::span<const size_t> group : groups) {
      std::vector<const ActionPhrase*> alike;
      for (const size_t k : group) alike.push_back(&phrases[k]);
      const bool is_bare = taken.empty() && group.size() == 1 && !alike[0]->always_number;
      const std::vector<std::string> apart =
          is_bare ? std::vector<std::string>{words} : TellApart(alike, taken);
      for (size_t i = 0; i < group.size(); ++i) names[group[i]] = apart[i];
      taken.insert(apart.begin(), apart.end());
    }
  }
  return names;
}

std::vector<std::string> DisplayNames(const v1::ModelManifest& manifest) {
  std::vector<std::string> names = DerivedNames(manifest);
  for (size_t k = 0; k < names.size(); ++k) {
    const std::string& label = manifest.actions(static_cast<int>(k)).label();
    if (!label.empty()) names[k] = label;
  }
  for (int k = manifest.actions_size(); k < manifest.spec().actions(); ++k) {
    names.push_back(NumberedName(k));
  }
  return names;
}

void CompleteActionNames(v1::ModelManifest& manifest) {
  const std::vector<std::string> derived = DerivedNames(manifest);
  const std::vector<std::string> display = DisplayNames(manifest);
  for (size_t k = 0; k < derived.size(); ++k) {
    v1::Action& action = *manifest.mutable_actions(static_cast<int>(k));
    action.set_derived_name(derived[k]);
    action.set_display_name(display[k]);
  }
}

}  // namespace maneuver::evaluation
