#include "model/evaluation/rival_requirements.h"

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "model/evaluation/metric_table.h"
#include "model/evaluation/rival_table.h"

namespace maneuver::evaluation {
namespace {

std::string MetricOf(const v1::RivalRequirement& requirement) {
  return requirement.metric().empty() ? "ade_1" : requirement.metric();
}

bool IsMet(v1::RivalStandard standard, v1::RivalVerdict verdict) {
  if (standard == v1::RIVAL_STANDARD_NOT_BEHIND) {
    return verdict == v1::RIVAL_VERDICT_AHEAD || verdict == v1::RIVAL_VERDICT_UNDECIDED;
  }
  return verdict == v1::RIVAL_VERDICT_AHEAD;
}

const v1::RivalComparison* FindComparison(const v1::RivalStanding& part,
                                          const v1::RivalRequirement& requirement) {
  const auto found = std::ranges::find_if(part.comparisons(), [&](const auto& each) {
    return each.rival() == requirement.rival() && each.metric() == MetricOf(requirement);
  });
  return found == part.comparisons().end() ? nullptr : &*found;
}

v1::RivalShortfall ShortfallIn(const v1::RivalStanding& part,
                               const v1::RivalRequirement& requirement) {
  v1::RivalShortfall shortfall;
  *shortfall.mutable_requirement() = requirement;
  shortfall.set_dimension(part.dimension());
  shortfall.set_name(part.name());
  shortfall.set_examples(part.examples());
  shortfall.set_groups(part.groups());
  return shortfall;
}

// Returns "ahead of constant velocity by ade_1", for example.
std::string Wanted(const v1::RivalRequirement& requirement) {
  const Rival* rival = FindRival(requirement.rival());
  return absl::StrCat(
      requirement.standard() == v1::RIVAL_STANDARD_NOT_BEHIND ? "not behind " : "ahead of ",
      rival == nullptr ? requirement.rival() : std::string(rival->title), " by ",
      MetricOf(requirement));
}

// Returns "in stationary (+0.012 m, 95 % +0.003 .. +0.020)", for example.
std::string WhereText(const v1::RivalShortfall& shortfall) {
  std::string text =
      shortfall.name().empty() ? "over all examples" : absl::StrCat("in ", shortfall.name());
  if (!shortfall.has_comparison()) {
    absl::StrAppend(&text, shortfall.examples() < kLeastComparedExamples
                               ? absl::StrCat(" (", shortfall.examples(), " examples are too few)")
                               : " (the evaluation has no such rival)");
    return text;
  }
  const v1::Estimate& difference = shortfall.comparison().difference();
  const std::optional<MetricInfo> metric = FindMetric(shortfall.comparison().metric());
  const std::string unit = metric && metric->unit == "m" ? " m" : "";
  absl::StrAppend(&text, absl::StrFormat(" (%+.3f%s, 95 %% %+.3f .. %+.3f", difference.value(),
                                         unit, difference.lower(), difference.upper()));
  if (shortfall.groups() < kLeastDecidingGroups) {
    absl::StrAppend(&text, "; ", shortfall.groups(), shortfall.groups() == 1 ? " group" : " groups",
                    " of recordings cannot decide");
  }
  return text + ")";
}

bool AreOfOne(const v1::RivalRequirement& a, const v1::RivalRequirement& b) {
  return Wanted(a) == Wanted(b);
}

}  // namespace

RequirementFault CheckRequirement(const v1::RivalRequirement& requirement) {
  const Rival* rival = FindRival(requirement.rival());
  if (rival == nullptr) {
    return {"rival", "is none of cv, ctra, faded, covernet and multipath"};
  }
  if (RivalMetric(*rival, MetricOf(requirement)).empty()) {
    std::vector<std::string> metrics;
    for (const std::string_view metric : kComparedMetrics) {
      if (!RivalMetric(*rival, metric).empty()) metrics.emplace_back(metric);
    }
    return {"metric", absl::StrCat("cannot be compared with ", std::string(rival->title),
                                   "; these can: ", absl::StrJoin(metrics, ", "))};
  }
  if (!v1::RivalStandard_IsValid(requirement.standard())) {
    return {"standard", "is not a standard that this server knows"};
  }
  if (!v1::RivalScope_IsValid(requirement.scope())) {
    return {"scope", "is not a scope that this server knows"};
  }
  return {};
}

std::vector<v1::RivalShortfall> FindShortfalls(const v1::RivalStandings& standings,
                                               const RivalRequirements& requirements) {
  std::vector<v1::RivalShortfall> shortfalls;
  for (const v1::RivalRequirement& requirement : requirements) {
    if (standings.parts().empty()) {
      shortfalls.push_back(ShortfallIn(v1::RivalStanding(), requirement));
    }
    for (const v1::RivalStanding& part : standings.parts()) {
      const bool is_all = part.dimension().empty();
      if (!is_all && requirement.scope() != v1::RIVAL_SCOPE_EVERY_STRATUM) continue;
      if (!is_all && part.examples() < kLeastComparedExamples) continue;
      const v1::RivalComparison* comparison = FindComparison(part, requirement);
      if (comparison != nullptr && IsMet(requirement.standard(), comparison->verdict())) continue;
      v1::RivalShortfall& shortfall = shortfalls.emplace_back(ShortfallIn(part, requirement));
      if (comparison == nullptr) break;  // missing in all parts
      *shortfall.mutable_comparison() = *comparison;
    }
  }
  return shortfalls;
}

std::string ShortfallText(const std::vector<v1::RivalShortfall>& shortfalls) {
  std::string text;
  for (size_t i = 0; i < shortfalls.size(); ++i) {
    const v1::RivalRequirement& requirement = shortfalls[i].requirement();
    if (i > 0 && AreOfOne(shortfalls[i - 1].requirement(), requirement)) {
      absl::StrAppend(&text, ", ", WhereText(shortfalls[i]));
      continue;
    }
    const bool may_tie = requirement.standard() == v1::RIVAL_STANDARD_NOT_BEHIND;
    std::string wanted = Wanted(requirement);
    // A failed requirement "not behind X" reads "behind X".
    if (may_tie && shortfalls[i].has_comparison()) {
      wanted = wanted.substr(std::string_view("not ").size());
    } else {
      wanted = absl::StrCat(may_tie ? "not shown to be " : "not ", wanted);
    }
    absl::StrAppend(&text, text.empty() ? "" : "; ", wanted, " ", WhereText(shortfalls[i]));
  }
  return text;
}

std::string RequirementText(const v1::RivalRequirement& requirement) {
  return absl::StrCat(Wanted(requirement), requirement.scope() == v1::RIVAL_SCOPE_EVERY_STRATUM
                                               ? " in every stratum"
                                               : " over all examples");
}

}  // namespace maneuver::evaluation
