#include "client/cli/scenario_source.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/resource_names.h"
#include "model/data/dataset_folder.h"

namespace maneuver::cli {
namespace {

// Returns how to name a dataset on the server; empty if the source cannot be the name of one.
std::string Hint(const std::string& source) {
  if (source.find_first_of("/.") != std::string::npos) return "";
  return absl::StrCat("; for a dataset on the server use ", DatasetResource(source));
}

absl::Status CheckFolder(const std::string& source) {
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::path(source) / "dataset.json", error)) {
    return absl::OkStatus();
  }
  if (error) return absl::NotFoundError(absl::StrCat(source, ": ", error.message()));
  if (!std::filesystem::exists(source, error)) return MissingSource(source);
  return absl::NotFoundError(absl::StrCat(source, " is not a dataset folder", Hint(source)));
}

}  // namespace

absl::Status MissingSource(const std::string& source) {
  return absl::NotFoundError(absl::StrCat(source, " does not exist", Hint(source)));
}

int FailAtSource(const std::string& source, const absl::Status& status, Environment& environment) {
  return IsOnServer(source) ? environment.FailCall(status) : environment.Fail(status);
}

bool IsOnServer(const std::string& source) {
  return source.starts_with("datasets/") &&
         source.find('/', sizeof("datasets/") - 1) == std::string::npos;
}

v1::ScenarioSummary Summarize(const v1::Scenario& scenario) {
  v1::ScenarioSummary summary;
  summary.set_scenario_id(scenario.scenario_id());
  bool any = false;
  double start = 0.0;
  double end = 0.0;
  int vehicles = 0;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.type() == v1::AGENT_TYPE_VEHICLE) ++vehicles;
    if (agent.states().empty()) continue;
    const double first = agent.states().begin()->time();
    const double last = agent.states().rbegin()->time();
    start = any ? std::min(start, first) : first;
    end = any ? std::max(end, last) : last;
    any = true;
  }
  summary.set_start_time(start);
  summary.set_end_time(end);
  summary.set_agents(scenario.agents_size());
  summary.set_vehicles(vehicles);
  int points = 0;
  for (const v1::MapFeature& feature : scenario.map_features()) points += feature.x_size();
  summary.set_map_points(points);
  *summary.mutable_target_ids() = scenario.target_ids();
  return summary;
}

absl::StatusOr<v1::ListScenariosResponse> ListScenarios(const std::string& source, int64_t most,
                                                        Environment& environment) {
  v1::ListScenariosResponse all;
  const auto enough = [&] { return most > 0 && all.scenarios_size() >= most; };
  if (IsOnServer(source)) {
    v1::ListScenariosRequest request;
    request.set_parent(source);
    do {
      request.set_page_size(static_cast<int32_t>(
          most > 0 ? std::min<int64_t>(most - all.scenarios_size(), 1'000) : 1'000));
      auto page = environment.server_client().ListScenarios(request, environment.call_options());
      if (!page.ok()) return page.status();
      request.set_page_token(page->next_page_token());
      page->clear_next_page_token();
      all.MergeFrom(*page);
    } while (!request.page_token().empty() && !enough());
    return all;
  }
  absl::Status status = CheckFolder(source);
  if (!status.ok()) return status;
  status = data::ForEachScenario(source, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
    *all.add_scenarios() = Summarize(scenario);
    return !enough();
  });
  if (!status.ok()) return status;
  return all;
}

absl::StatusOr<v1::Scenario> GetScenario(const std::string& source, const std::string& scenario_id,
                                         Environment& environment) {
  if (!IsOnServer(source)) {
    const absl::Status status = CheckFolder(source);
    if (!status.ok()) return status;
    return data::ReadScenario(source, scenario_id);
  }
  v1::GetScenarioRequest request;
  request.set_parent(source);
  request.set_scenario_id(scenario_id);
  return environment.server_client().GetScenario(request, environment.call_options());
}

absl::Status VisitScenarios(const std::string& source, int64_t most, Environment& environment,
                            const std::function<void(v1::Scenario&&)>& visit) {
  if (!IsOnServer(source)) {
    if (absl::Status status = CheckFolder(source); !status.ok()) return status;
    int64_t left = most;
    return data::ForEachScenario(source, data::OnDamage::kStop, [&](v1::Scenario&& scenario) {
      visit(std::move(scenario));
      return --left != 0;
    });
  }
  const auto list = ListScenarios(source, most, environment);
  if (!list.ok()) return list.status();
  for (const v1::ScenarioSummary& summary : list->scenarios()) {
    auto scenario = GetScenario(source, summary.scenario_id(), environment);
    if (!scenario.ok()) return scenario.status();
    visit(*std::move(scenario));
  }
  return absl::OkStatus();
}

}  // namespace maneuver::cli
