#include "tests/postgresql/query_plans.h"

#include <fstream>
#include <regex>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace maneuver::postgresql {
namespace {

constexpr int kFew = 100;

}  // namespace

std::vector<QueryPlan> ReadPlans(const std::filesystem::path& log) {
  std::vector<QueryPlan> plans;
  std::ifstream file(log);
  bool is_plan = false;
  bool is_statement = false;
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with("\t")) {
      is_plan = line.starts_with("maneuverd LOG:  duration: ") && absl::EndsWith(line, "plan:");
      continue;
    }
    if (!is_plan) continue;
    if (line.starts_with("\tQuery Text: ")) {
      plans.push_back({line.substr(13), ""});
      is_statement = true;
      continue;
    }
    // The steps begin with the costs of the first; a statement may have several lines.
    if (is_statement && !absl::StrContains(line, "(cost=")) {
      absl::StrAppend(&plans.back().statement, line);
      continue;
    }
    is_statement = false;
    absl::StrAppend(&plans.back().steps, line, "\n");
  }
  return plans;
}

bool ReadsRowsInVain(const QueryPlan& plan) {
  static const std::regex scan("Seq Scan on (jobs|progress|aliases|versions|datasets)");
  if (std::regex_search(plan.steps, scan)) return true;
  static const std::regex removed("Rows Removed by [A-Za-z ]*: ([0-9]+)");
  const std::sregex_iterator end;
  for (std::sregex_iterator each(plan.steps.begin(), plan.steps.end(), removed); each != end;
       ++each) {
    if (std::stoll((*each)[1]) > kFew) return true;
  }
  return false;
}

bool IsCompiled(const QueryPlan& plan) { return absl::StrContains(plan.steps, "JIT:"); }

}  // namespace maneuver::postgresql
