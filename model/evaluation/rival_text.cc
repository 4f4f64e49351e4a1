#include "model/evaluation/rival_text.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "model/evaluation/rival_table.h"
#include "model/evaluation/text_block.h"

namespace maneuver::evaluation {
namespace {

constexpr size_t kMostColumns = 100;
constexpr size_t kMostUndecidedNames = 3;

const v1::RivalComparison* Find(const v1::RivalStanding& part, const Rival& rival,
                                std::string_view metric) {
  const auto found = std::ranges::find_if(part.comparisons(), [&](const auto& each) {
    return each.rival() == rival.name && each.metric() == metric;
  });
  return found == part.comparisons().end() ? nullptr : &*found;
}

Block Table(const v1::RivalStandings& standings) {
  std::vector<std::string> titles = {"EXAMPLES"};
  for (const Rival& rival : kRivals) titles.emplace_back(rival.column);
  Block block("AHEAD BY ade_1, m?", std::move(titles));
  for (const v1::RivalStanding& part : standings.parts()) {
    if (part.comparisons().empty()) continue;
    std::vector<std::string> row = {absl::StrCat(part.examples())};
    for (const Rival& rival : kRivals) {
      const v1::RivalComparison* comparison = Find(part, rival, "ade_1");
      row.push_back(comparison == nullptr
                        ? ""
                        : absl::StrFormat("%s %+.2f", VerdictMark(comparison->verdict()),
                                          comparison->difference().value()));
    }
    block.Add(part.name().empty() ? "all" : part.name(), std::move(row));
  }
  return block;
}

// Breaks a line at spaces.
std::string Wrapped(const std::string& line) {
  std::string text;
  size_t column = 0;
  for (const absl::string_view word : absl::StrSplit(line, ' ')) {
    if (column > 0 && column + 1 + word.size() > kMostColumns) {
      absl::StrAppend(&text, "\n   ");
      column = 3;
    }
    absl::StrAppend(&text, column > 0 ? " " : "", word);
    column += word.size() + (column > 0 ? 1 : 0);
  }
  return text + "\n";
}

// Returns "ade_1: ahead of constant velocity in 12 of 13 strata, behind in stationary". Empty if
// the two are not compared by this metric.
std::string Summary(const v1::RivalStandings& standings, const Rival& rival,
                    std::string_view metric) {
  std::vector<std::string> behind;
  std::vector<std::string> undecided;
  size_t ahead = 0;
  for (const v1::RivalStanding& part : standings.parts()) {
    const v1::RivalComparison* comparison = Find(part, rival, metric);
    if (part.name().empty() || comparison == nullptr) continue;
    if (comparison->verdict() == v1::RIVAL_VERDICT_AHEAD) {
      ++ahead;
    } else if (comparison->verdict() == v1::RIVAL_VERDICT_BEHIND) {
      behind.push_back(part.name());
    } else {
      undecided.push_back(part.name());
    }
  }
  const size_t strata = ahead + behind.size() + undecided.size();
  if (strata == 0) return "";
  std::string text =
      absl::StrFormat("%s: ahead of %s in %d of %d strata", metric, rival.title, ahead, strata);
  if (!behind.empty()) absl::StrAppend(&text, ", behind in ", absl::StrJoin(behind, ", "));
  if (undecided.size() > kMostUndecidedNames) {
    absl::StrAppend(&text, ", undecided in ", undecided.size());
  } else if (!undecided.empty()) {
    absl::StrAppend(&text, ", undecided in ", absl::StrJoin(undecided, ", "));
  }
  return Wrapped(text);
}

std::string Legend(const v1::RivalStandings& standings) {
  std::string text = absl::StrFormat(
      "Mean differences. ahead, BEHIND: the whole 95 %% interval is below, above 0; ?: it cannot "
      "tell. The %d recordings are %d %s that share no place and no drive.",
      standings.recordings(), standings.groups(), standings.groups() == 1 ? "group" : "groups");
  if (standings.groups() < kLeastDecidingGroups) {
    absl::StrAppend(&text, " Fewer than ", kLeastDecidingGroups, " decide nothing.");
  } else if (standings.groups() < kFewGroups) {
    absl::StrAppend(&text, " They are few: the intervals are too narrow.");
  }
  return Wrapped(text);
}

}  // namespace

std::string_view VerdictMark(v1::RivalVerdict verdict) {
  if (verdict == v1::RIVAL_VERDICT_AHEAD) return "ahead";
  return verdict == v1::RIVAL_VERDICT_BEHIND ? "BEHIND" : "?";
}

std::string RivalText(const v1::RivalStandings& standings, bool color) {
  const Block table = Table(standings);
  if (table.empty()) return "";
  std::string text = table.Text(color);
  for (const Rival& rival : kRivals) {
    absl::StrAppend(&text, Summary(standings, rival, "ade_1"));
    if (rival.trained) absl::StrAppend(&text, Summary(standings, rival, "min_ade_6"));
  }
  return text + Legend(standings);
}

}  // namespace maneuver::evaluation
