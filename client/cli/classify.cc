// maneuver classify: which action was the trajectory that each target really took?

#include <algorithm>
#include <memory>
#include <numeric>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "client/cli/action_titles.h"
#include "client/cli/commands.h"
#include "client/cli/priority_option.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_files.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"

namespace maneuver::cli {
namespace {

struct ClassifyArguments {
  std::vector<std::string> files;
  std::string model;
  std::optional<double> deadline;
  std::string priority = "interactive";
  std::vector<std::string> required_names;
  bool strict = false;
};

int Classify(const ClassifyArguments& arguments, Environment& environment) {
  const auto scenarios = ReadScenarios(arguments.files, environment);
  if (!scenarios.ok()) return environment.Refuse(std::string(scenarios.status().message()));
  v1::ClassifyTrajectoriesRequest request;
  request.set_model(ModelResource(arguments.model));
  request.set_priority(PriorityNamed(arguments.priority));
  request.set_include_action_names(true);
  request.set_strict(arguments.strict);
  request.mutable_required_action_names()->Add(arguments.required_names.begin(),
                                               arguments.required_names.end());
  request.mutable_scenarios()->Add(scenarios->begin(), scenarios->end());
  client::CallOptions call = environment.call_options();
  if (arguments.deadline) {
    call.timeout = absl::Milliseconds(*arguments.deadline);
    environment.time_limit = "--deadline MILLISECONDS";
  }
  const auto answer = environment.server_client().ClassifyTrajectories(request, call);
  if (!answer.ok()) return environment.FailCall(answer.status());
  if (environment.json()) environment.PrintJson(*answer);

  bool all_answered = true;
  Table table({{"SCENARIO"},
               {"TARGET", Align::kRight},
               {"ACTION", Align::kRight},
               {"NAME"},
               {"q(y|x,s)", Align::kRight},
               {"p(y|s)", Align::kRight},
               {"BOUND, nats", Align::kRight}});
  for (const v1::ScenarioClassification& scenario : answer->classifications()) {
    if (scenario.has_error()) {
      ReportItemError(scenario.scenario_id(), scenario.error(), environment);
      all_answered = false;
    }
    ReportWarnings(scenario.scenario_id(), scenario.warnings(), environment);
    for (const v1::TargetClassification& target : scenario.targets()) {
      if (target.has_error()) {
        ReportItemError(TargetName(scenario.scenario_id(), target.target_id()), target.error(),
                        environment);
        all_answered = false;
        continue;
      }
      std::vector<int> order(static_cast<size_t>(target.responsibilities_size()));
      std::iota(order.begin(), order.end(), 0);
      std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return target.responsibilities(a) > target.responsibilities(b);
      });
      constexpr double kWorthShowing = 0.05;
      for (const int id : order) {
        const bool first = id == order.front();
        if (!first && target.responsibilities(id) < kWorthShowing) break;
        table.Add({first ? scenario.scenario_id() : "",
                   first ? absl::StrCat(target.target_id()) : "", absl::StrCat(id),
                   TitleOf(answer->action_names(), id), Share(target.responsibilities(id)),
                   id < target.probabilities_size() ? Share(target.probabilities(id)) : "-",
                   first ? Fixed(target.log_likelihood_bound(), 2) : ""});
      }
    }
  }
  if (!environment.json() && !table.empty()) environment.out << table.Text(environment.color);
  return all_answered ? kOk : kFailed;
}

}  // namespace

void AddClassify(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<ClassifyArguments>();
  Command command = root.Add("classify", "Which action did a target take?",
                             "Computes q(y|x,s) from the states after the prediction time. The "
                             "scene must contain them up to\n"
                             "the model's horizon.\n"
                             "Example: maneuver scenario extract town town-1-0 -o scene.json\n"
                             "         maneuver classify scene.json --model town");
  command.Arguments("FILE", &arguments->files, "Scenario as proto3 JSON; - for standard input");
  command.Option(
      "--model", &arguments->model,
      "town (the version that serves), town/2 or town@candidate [the only one that serves]");
  command.Option("--deadline", &arguments->deadline, 1.0, 1e7, "Most milliseconds for the answer");
  AddPriorityOption(command, &arguments->priority);
  AddRequireNameOption(command, &arguments->required_names);
  AddStrictOption(command, &arguments->strict);
  command.Run([arguments, &environment] { return Classify(*arguments, environment); });
}

}  // namespace maneuver::cli
