// maneuver scenario: list, show, extract.

#include <cmath>
#include <memory>
#include <optional>
#include <ostream>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/cli/commands.h"
#include "client/cli/json_files.h"
#include "client/cli/scenario_source.h"
#include "client/cli/table.h"
#include "client/cli/target_selection.h"
#include "client/cli/text_format.h"
#include "client/observed_scenario.h"
#include "client/plot/scene_plot.h"
#include "model/scene/target_frame.h"

namespace maneuver::cli {
namespace {

struct ScenarioArguments {
  std::string source;
  std::string scenario_id;
  int64_t most = 0;
  std::optional<double> time;
  std::vector<int64_t> targets;
  std::string type = "vehicle";
  bool no_future = false;
  std::optional<std::string> file;
  std::optional<std::string> plot;
  bool paths = false;
};

int PrintScenarios(const ScenarioArguments& arguments, Environment& environment) {
  const auto all = ListScenarios(arguments.source, arguments.most, environment);
  if (!all.ok()) return FailAtSource(arguments.source, all.status(), environment);
  if (environment.json()) {
    environment.PrintJson(*all);
    return kOk;
  }
  Table table({{"SCENARIO"},
               {"START", Align::kRight},
               {"LENGTH", Align::kRight},
               {"AGENTS", Align::kRight},
               {"VEHICLES", Align::kRight},
               {"MAP POINTS", Align::kRight},
               {"TARGETS"}});
  for (const v1::ScenarioSummary& scenario : all->scenarios()) {
    table.Add({scenario.scenario_id(), Fixed(scenario.start_time(), 1),
               Spell(scenario.end_time() - scenario.start_time()), absl::StrCat(scenario.agents()),
               absl::StrCat(scenario.vehicles()), absl::StrCat(scenario.map_points()),
               absl::StrJoin(scenario.target_ids(), " ")});
  }
  environment.out << table.Text(environment.color);
  return kOk;
}

std::string TypeName(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_VEHICLE:
      return "vehicle";
    case v1::AGENT_TYPE_PEDESTRIAN:
      return "pedestrian";
    case v1::AGENT_TYPE_CYCLIST:
      return "cyclist";
    case v1::AGENT_TYPE_OTHER:
      return "other";
    default:
      return "-";
  }
}

// Draws the targets of a recording, without predictions.
int PlotScenario(const ScenarioArguments& arguments, const v1::Scenario& scenario,
                 Environment& environment) {
  v1::ScenarioPrediction nothing_predicted;
  for (const int64_t id :
       DefaultTargets(scenario, v1::AGENT_TYPE_VEHICLE, scenario.prediction_time())) {
    nothing_predicted.add_targets()->set_target_id(id);
  }
  plot::ScenePlotOptions options;
  options.lane_paths = arguments.paths;
  const absl::StatusOr<std::string> picture = plot::DrawScene(scenario, nothing_predicted, options);
  const absl::Status status =
      picture.ok() ? WriteFile(*arguments.plot, *picture) : picture.status();
  if (!status.ok()) return environment.Fail(status);
  environment.err << "the picture is " << *arguments.plot << "\n";
  return kOk;
}

void PrintScenario(const v1::Scenario& scenario, Environment& environment) {
  const v1::ScenarioSummary summary = Summarize(scenario);
  if (environment.json()) {
    environment.PrintJson(summary);
    return;
  }
  Table facts({{"SCENARIO"}, {scenario.scenario_id()}});
  facts.Add({"from", Fixed(summary.start_time(), 2) + " s"});
  facts.Add({"to", Fixed(summary.end_time(), 2) + " s"});
  facts.Add({"prediction time", Fixed(scenario.prediction_time(), 2) + " s"});
  facts.Add({"targets", absl::StrJoin(summary.target_ids(), " ")});
  facts.Add({"map features", absl::StrCat(scenario.map_features_size())});
  facts.Add({"map points", absl::StrCat(summary.map_points())});
  facts.Add({"traffic signals", absl::StrCat(scenario.traffic_signals_size())});
  environment.out << facts.Text(environment.color) << "\n";
  Table agents({{"AGENT", Align::kRight},
                {"TYPE"},
                {"SIZE"},
                {"SEEN FROM", Align::kRight},
                {"TO", Align::kRight},
                {"TRAVELS", Align::kRight}});
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.states().empty()) continue;
    const v1::AgentState& first = *agent.states().begin();
    const v1::AgentState& last = *agent.states().rbegin();
    double path = 0.0;
    for (int i = 1; i < agent.states_size(); ++i) {
      path += std::hypot(agent.states(i).x() - agent.states(i - 1).x(),
                         agent.states(i).y() - agent.states(i - 1).y());
    }
    agents.Add({absl::StrCat(agent.id()), TypeName(agent.type()),
                absl::StrCat(Fixed(agent.length(), 1), " x ", Fixed(agent.width(), 1), " m"),
                Fixed(first.time(), 1), Fixed(last.time(), 1), Fixed(path, 0) + " m"});
  }
  environment.out << agents.Text(environment.color);
}

int ShowScenario(const ScenarioArguments& arguments, Environment& environment) {
  const auto scenario = GetScenario(arguments.source, arguments.scenario_id, environment);
  if (!scenario.ok()) return FailAtSource(arguments.source, scenario.status(), environment);
  PrintScenario(*scenario, environment);
  return arguments.plot ? PlotScenario(arguments, *scenario, environment) : kOk;
}

// Of the name that TypeName() gives it.
v1::AgentType TypeOf(const std::string& name) {
  for (const v1::AgentType type : {v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST}) {
    if (TypeName(type) == name) return type;
  }
  return v1::AGENT_TYPE_VEHICLE;
}

int Extract(const ScenarioArguments& arguments, Environment& environment) {
  auto scenario = GetScenario(arguments.source, arguments.scenario_id, environment);
  if (!scenario.ok()) return FailAtSource(arguments.source, scenario.status(), environment);
  if (arguments.time) scenario->set_prediction_time(*arguments.time);
  const double time = scenario->prediction_time();

  std::vector<int64_t> targets = arguments.targets;
  for (const int64_t id : targets) {
    const v1::Agent* const agent = scene::FindAgent(*scenario, id);
    if (agent == nullptr || CurrentState(*agent, time) < 0) {
      return environment.Refuse(absl::StrCat(
          "target ", id, agent == nullptr ? " is not an agent of " : " is not visible in ",
          scenario->scenario_id(), agent == nullptr ? "" : absl::StrCat(" at ", time, " s"),
          "; see maneuver scenario show"));
    }
  }
  if (targets.empty()) targets = DefaultTargets(*scenario, TypeOf(arguments.type), time);
  if (targets.empty()) {
    return environment.Refuse(
        absl::StrCat("no ", arguments.type, " of ", scenario->scenario_id(), " moves at ", time,
                     " s with a second of history; choose another --time, or a --target"));
  }
  scenario->mutable_target_ids()->Assign(targets.begin(), targets.end());
  if (arguments.no_future) client::StripFuture(&*scenario);

  const std::string text = ToCompactJson(*scenario);
  if (!arguments.file || *arguments.file == "-") {
    environment.out << text;
    return kOk;
  }
  const absl::Status status = WriteFile(*arguments.file, text);
  if (!status.ok()) return environment.Fail(status);
  environment.err << *arguments.file << ": " << Printable(scenario->scenario_id()) << " at "
                  << Fixed(time, 1) << " s, targets " << absl::StrJoin(targets, " ") << "\n";
  return kOk;
}

}  // namespace

void AddScenario(Command& root, Environment& environment) {
  Command group = root.Add("scenario", "Recordings of a dataset");
  const auto arguments = std::make_shared<ScenarioArguments>();
  const std::string source_help = "A dataset folder, or datasets/NAME on the server";

  Command list = group.Add("list", "The recordings of a dataset",
                           "Example: maneuver scenario list town\n"
                           "         maneuver scenario list datasets/town --most 10");
  list.Argument("SOURCE", &arguments->source, source_help);
  list.Option("--most", &arguments->most, 0, INT64_MAX, "Most recordings to print; 0: all");
  list.Run([=, &environment] { return PrintScenarios(*arguments, environment); });

  Command show =
      group.Add("show", "Summarise one recording",
                "Example: maneuver scenario show town town-1-0\n"
                "         maneuver scenario show town town-1-0 --plot scene.png --paths");
  show.Argument("SOURCE", &arguments->source, source_help);
  show.Argument("SCENARIO_ID", &arguments->scenario_id, "Which recording");
  show.Picture("--plot", &arguments->plot,
               "PNG file to draw its targets into, at its prediction time");
  show.Flag("--paths", &arguments->paths, "Also draw the lane paths of each target");
  show.Need("--paths", "--plot");
  show.Run([=, &environment] { return ShowScenario(*arguments, environment); });

  Command extract =
      group.Add("extract", "Extract one scene of a dataset as JSON",
                "Writes a Scenario as proto3 JSON for maneuver predict. Without --target its "
                "targets are the agents\n"
                "of --type that the recording names, or else those that move (at most 8). The "
                "future is kept for\n"
                "classify and for plots; predictions never see it.\n"
                "Example: maneuver scenario extract town town-1-0 --time 4 -o scene.json\n"
                "Then:    maneuver predict scene.json --plot scene.png");
  extract.Argument("SOURCE", &arguments->source, source_help);
  extract.Argument("SCENARIO_ID", &arguments->scenario_id, "Which recording");
  extract.Option("--time", &arguments->time, -1e12, 1e12,
                 "Prediction time, seconds on the recording's clock [the recording's own]");
  extract.Option("--target", &arguments->targets, INT64_MIN, INT64_MAX,
                 "Agents to ask about, by id, such as 7,12");
  extract.Choice("--type", &arguments->type, {"vehicle", "pedestrian", "cyclist"},
                 "Type of the agents to ask about");
  extract.Exclude("--type", "--target");
  extract.Flag("--no-future,!--with-future", &arguments->no_future,
               "Leave out states after the prediction time");
  extract.Option("-o,--out", &arguments->file, "File to write [standard output]");
  extract.Run([=, &environment] { return Extract(*arguments, environment); });
}

}  // namespace maneuver::cli
