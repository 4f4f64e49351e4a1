#include "client/cli/found_shares.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::cli {
namespace {

constexpr size_t kMostShareRows = 40;
constexpr size_t kMostSharePanels = 8;

// Ranges and hours by their first number, other names by their letters.
bool ComesBefore(const std::string& a, const std::string& b) {
  char* end_a = nullptr;
  char* end_b = nullptr;
  const double first = std::strtod(a.c_str(), &end_a);
  const double second = std::strtod(b.c_str(), &end_b);
  const bool numbers = end_a != a.c_str() && end_b != b.c_str();
  return numbers && first != second ? first < second : a < b;
}

// The `most` names with the most windows.
std::vector<std::string> Largest(const std::map<std::string, int64_t>& windows, size_t most) {
  std::vector<std::string> names;
  names.reserve(windows.size());
  for (const auto& [name, count] : windows) names.push_back(name);
  std::ranges::stable_sort(names, std::greater(),
                           [&](const std::string& name) { return windows.at(name); });
  if (names.size() > most) names.resize(most);
  return names;
}

plot::PlottedShare ToPlotted(const tags::ShareInterval& interval) {
  return {interval.share, interval.low, interval.high};
}

}  // namespace

std::vector<std::string> PartNames(const tags::Found& found, const tags::Found* against) {
  std::set<std::string> all;
  for (const auto& [name, part] : found.parts) all.insert(name);
  if (against != nullptr) {
    for (const auto& [name, part] : against->parts) all.insert(name);
  }
  std::vector<std::string> names(all.begin(), all.end());
  std::ranges::stable_sort(names, ComesBefore);
  return names;
}

const tags::Statistics& PartOf(const tags::Found& found, const std::string& part) {
  static const tags::Statistics kNothing;
  const auto known = found.parts.find(part);
  return known == found.parts.end() ? kNothing : known->second;
}

plot::SharePlot SharePlotOf(const tags::Found& found, const tags::Found* against,
                            const std::string& by, const std::string& per, const std::string& name,
                            const std::string& other) {
  plot::SharePlot shares;
  shares.name = name;
  if (against != nullptr) shares.against = other;
  std::map<std::string, int64_t> groups;
  std::map<std::string, int64_t> parts;
  for (const tags::Found* each : {&found, against}) {
    if (each == nullptr) continue;
    for (const auto& [group, sums] : each->groups) groups[group] += sums.windows;
    for (const auto& [part, sums] : each->parts) parts[part] += sums.all.windows;
  }
  shares.rows = Largest(groups, kMostShareRows);
  // Actions and places by how often they are, ranges and hours in their own order.
  if (by == "speed" || by == "hour") std::ranges::stable_sort(shares.rows, ComesBefore);
  std::vector<std::string> shown = Largest(parts, kMostSharePanels);
  std::ranges::stable_sort(shown, ComesBefore);
  const auto add = [&](const std::string& title, const tags::Statistics& these,
                       const tags::Statistics* those) {
    plot::SharePanel panel{title, absl::StrCat(these.all.windows, " windows"), {}};
    if (those != nullptr) absl::StrAppend(&panel.subtitle, ", ", those->all.windows);
    for (const std::string& row : shares.rows) {
      plot::ShareCell cell{ToPlotted(tags::IntervalOf(these, row)), std::nullopt, false};
      if (those != nullptr) {
        const tags::Change change = tags::Compare(these, *those, row);
        cell.against = ToPlotted(tags::IntervalOf(*those, row));
        cell.changed = change.low > 0.0 || change.high < 0.0;
      }
      panel.cells.push_back(cell);
    }
    shares.panels.push_back(std::move(panel));
  };
  if (per.empty()) add("all", found, against);
  for (const std::string& part : shown) {
    const std::string unit = per == "speed" ? " m/s" : per == "hour" ? " h UTC" : "";
    add(part + unit, PartOf(found, part), against == nullptr ? nullptr : &PartOf(*against, part));
  }
  shares.title =
      absl::StrCat("Shares by ", by, per.empty() ? "" : absl::StrCat(", for each ", per));
  shares.subtitle = against == nullptr ? name : absl::StrCat(name, " against ", other);
  if (against != nullptr)
    absl::StrAppend(&shares.subtitle, "; coloured: the interval of the change leaves out 0");
  const size_t rows = groups.size() - shares.rows.size();
  const size_t panels = parts.size() - shown.size();
  if (rows > 0) absl::StrAppend(&shares.subtitle, "; ", rows, " rare ones are left out");
  if (panels > 0) absl::StrAppend(&shares.subtitle, "; ", panels, " small parts are left out");
  return shares;
}

}  // namespace maneuver::cli
