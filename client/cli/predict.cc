// maneuver probability, distribution, predict: the two questions, and both at once.

#include <algorithm>
#include <cmath>
#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/action_titles.h"
#include "client/cli/commands.h"
#include "client/cli/json_files.h"
#include "client/cli/priority_option.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_files.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/observed_scenario.h"
#include "client/plot/scene_plot.h"

namespace maneuver::cli {
namespace {

struct PredictArguments {
  std::vector<std::string> files;
  std::string model;
  std::vector<int64_t> actions;
  std::optional<double> min_probability;
  std::optional<int64_t> top_k;
  std::optional<int64_t> representatives;
  std::optional<int64_t> joint;
  bool prior = false;
  std::string frame = "world";
  std::optional<double> deadline;
  std::string priority = "interactive";
  std::vector<std::string> required_names;
  bool strict = false;
  std::optional<std::string> plot;
  bool paths = false;
  double at_least = 0.02;
};

using Predictions = google::protobuf::RepeatedPtrField<v1::ScenarioPrediction>;

v1::DistributionQuery Query(const PredictArguments& arguments) {
  v1::DistributionQuery query;
  if (!arguments.actions.empty()) {
    for (const int64_t id : arguments.actions) {
      query.mutable_action_ids()->add_ids(static_cast<int32_t>(id));
    }
  } else if (arguments.top_k) {
    query.set_top_k(static_cast<int32_t>(*arguments.top_k));
  } else if (arguments.min_probability) {
    query.set_min_probability(*arguments.min_probability);
  }
  query.set_representatives(static_cast<int32_t>(arguments.representatives.value_or(0)));
  query.set_joint_combinations(static_cast<int32_t>(arguments.joint.value_or(0)));
  query.set_source(arguments.prior ? v1::LATENT_SOURCE_PRIOR : v1::LATENT_SOURCE_POSTERIOR);
  query.set_frame(arguments.frame == "target" ? v1::FRAME_TARGET : v1::FRAME_WORLD);
  return query;
}

client::CallOptions Options(const PredictArguments& arguments, Environment& environment) {
  client::CallOptions call = environment.call_options();
  if (arguments.deadline) {
    call.timeout = absl::Milliseconds(*arguments.deadline);
    environment.time_limit = "--deadline MILLISECONDS";
  }
  return call;
}

// Reports warnings, and scenarios and targets that were refused. Returns true if none was refused.
bool ReportItems(const Predictions& predictions, Environment& environment) {
  bool all_answered = true;
  for (const v1::ScenarioPrediction& prediction : predictions) {
    if (prediction.has_error()) {
      ReportItemError(prediction.scenario_id(), prediction.error(), environment);
      all_answered = false;
    }
    ReportWarnings(prediction.scenario_id(), prediction.warnings(), environment);
    for (const v1::TargetPrediction& target : prediction.targets()) {
      if (!target.has_error()) continue;
      ReportItemError(TargetName(prediction.scenario_id(), target.target_id()), target.error(),
                      environment);
      all_answered = false;
    }
  }
  return all_answered;
}

bool HasAnswers(const Predictions& predictions) {
  return std::ranges::any_of(predictions, [](const v1::ScenarioPrediction& prediction) {
    return std::ranges::any_of(prediction.targets(), [](const v1::TargetPrediction& target) {
      return !target.has_error();
    });
  });
}

void PrintProbabilities(const Predictions& predictions, double at_least, const ActionTitles& titles,
                        Environment& environment) {
  Table table({{"SCENARIO"},
               {"TARGET", Align::kRight},
               {"ACTION", Align::kRight},
               {"NAME"},
               {"PROBABILITY", Align::kRight}});
  for (const v1::ScenarioPrediction& prediction : predictions) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      std::vector<int> order;
      double rest = 0.0;
      for (int i = 0; i < target.probabilities_size(); ++i) {
        if (target.probabilities(i) >= at_least) {
          order.push_back(i);
        } else {
          rest += target.probabilities(i);
        }
      }
      std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
        return target.probabilities(a) > target.probabilities(b);
      });
      for (const int id : order) {
        const bool first = id == order.front();
        table.Add({first ? prediction.scenario_id() : "",
                   first ? absl::StrCat(target.target_id()) : "", absl::StrCat(id),
                   TitleOf(titles, id), Share(target.probabilities(id))});
      }
      const auto others = static_cast<size_t>(target.probabilities_size()) - order.size();
      if (others == 0) continue;
      const bool first = order.empty();
      table.Add({first ? prediction.scenario_id() : "",
                 first ? absl::StrCat(target.target_id()) : "", "others",
                 absl::StrCat(others, " of them"), Share(rest)});
    }
  }
  environment.out << table.Text(environment.color);
}

// "12.3, -4.5 m": the mean trajectory at the last waypoint; "-" if it has none.
std::string EndOf(const v1::ActionDistribution& action) {
  const v1::Trajectory& mean = action.mean_trajectory();
  if (mean.x().empty() || mean.y().empty()) return "-";
  return absl::StrCat(Fixed(*mean.x().rbegin(), 1), ", ", Fixed(*mean.y().rbegin(), 1), " m");
}

std::string EndTitle(double horizon, const std::string& frame) {
  return absl::StrCat("AFTER ", ExactSeconds(horizon), " (", frame, ")");
}

// Actions that cover the mixture, the medoid first, with the probability that each stands for.
void PrintRepresentatives(const Predictions& predictions, double horizon, const std::string& frame,
                          const ActionTitles& titles, Environment& environment) {
  Table table({{"SCENARIO"},
               {"TARGET", Align::kRight},
               {"REPRESENTATIVE", Align::kRight},
               {"ACTION", Align::kRight},
               {"NAME"},
               {"WEIGHT", Align::kRight},
               {EndTitle(horizon, frame), Align::kRight}});
  for (const v1::ScenarioPrediction& prediction : predictions) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      for (int i = 0; i < target.representatives_size(); ++i) {
        const v1::Representative& representative = target.representatives(i);
        const int action = representative.action_id();
        const auto described =
            std::ranges::find(target.distributions(), action, &v1::ActionDistribution::action_id);
        table.Add({i == 0 ? prediction.scenario_id() : "",
                   i == 0 ? absl::StrCat(target.target_id()) : "",
                   i == 0 ? "1 (medoid)" : absl::StrCat(i + 1), absl::StrCat(action),
                   TitleOf(titles, action), Share(representative.weight()),
                   described == target.distributions().end() ? "-" : EndOf(*described)});
      }
    }
  }
  if (!table.empty()) environment.out << "\n" << table.Text(environment.color);
}

// A share that may be far below a thousandth.
std::string SmallShare(double share) {
  return share >= 0.001 ? Share(share) : absl::StrFormat("%.1g %%", 100.0 * share);
}

// Combinations of the targets' actions, the most probable first: a row for each target.
void PrintJoint(const Predictions& predictions, const ActionTitles& titles,
                Environment& environment) {
  Table table({{"SCENARIO"},
               {"COMBINATION", Align::kRight},
               {"WEIGHT", Align::kRight},
               {"PROBABILITY", Align::kRight},
               {"TARGET", Align::kRight},
               {"ACTION", Align::kRight},
               {"NAME"}});
  for (const v1::ScenarioPrediction& prediction : predictions) {
    const v1::JointPrediction& joint = prediction.joint();
    for (int n = 0; n < joint.combinations_size(); ++n) {
      const v1::JointCombination& combination = joint.combinations(n);
      const int targets = std::min(joint.target_ids_size(), combination.action_ids_size());
      for (int i = 0; i < targets; ++i) {
        const int action = combination.action_ids(i);
        table.Add({n == 0 && i == 0 ? prediction.scenario_id() : "",
                   i == 0 ? absl::StrCat(n + 1) : "", i == 0 ? Share(combination.weight()) : "",
                   i == 0 ? SmallShare(std::exp(combination.log_probability())) : "",
                   absl::StrCat(joint.target_ids(i)), absl::StrCat(action),
                   TitleOf(titles, action)});
      }
    }
  }
  if (!table.empty()) environment.out << "\n" << table.Text(environment.color);
}

// Says where there are no combinations, or fewer than there may be.
void ReportJoint(const Predictions& predictions, Environment& environment) {
  for (const v1::ScenarioPrediction& prediction : predictions) {
    if (!prediction.has_joint()) continue;
    const v1::JointPrediction& joint = prediction.joint();
    if (joint.truncated()) {
      environment.err << Printable(prediction.scenario_id())
                      << ": the search for combinations ended at its bound, with "
                      << joint.combinations_size() << " of them; ask for fewer targets at once\n";
    } else if (joint.combinations().empty()) {
      environment.err << Printable(prediction.scenario_id())
                      << ": two targets would collide in every combination of actions\n";
    }
  }
}

// The mean trajectory at the last waypoint and how far one standard deviation reaches there.
void PrintDistributions(const Predictions& predictions, double horizon, const std::string& frame,
                        const ActionTitles& titles, Environment& environment) {
  Table table({{"SCENARIO"},
               {"TARGET", Align::kRight},
               {"ACTION", Align::kRight},
               {"NAME"},
               {"PROBABILITY", Align::kRight},
               {EndTitle(horizon, frame), Align::kRight},
               {"STDDEV x, y", Align::kRight}});
  for (const v1::ScenarioPrediction& prediction : predictions) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      for (int i = 0; i < target.distributions_size(); ++i) {
        const v1::ActionDistribution& action = target.distributions(i);
        const v1::WaypointMoments& moments = action.moments();
        const bool has_moments =
            !moments.covariance_xx().empty() && !moments.covariance_yy().empty();
        table.Add({i == 0 ? prediction.scenario_id() : "",
                   i == 0 ? absl::StrCat(target.target_id()) : "", absl::StrCat(action.action_id()),
                   TitleOf(titles, action.action_id()), Share(action.probability()), EndOf(action),
                   has_moments
                       ? absl::StrCat(Fixed(std::sqrt(*moments.covariance_xx().rbegin()), 1), ", ",
                                      Fixed(std::sqrt(*moments.covariance_yy().rbegin()), 1), " m")
                       : "-"});
      }
    }
  }
  environment.out << table.Text(environment.color);
  for (const v1::ScenarioPrediction& prediction : predictions) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      if (target.has_error() || target.distributions_size() > 0) continue;
      environment.err
          << Printable(TargetName(prediction.scenario_id(), target.target_id()))
          << ": no action is as probable as was asked for (5 % by default); give --top-k 1 or a "
             "smaller --min-probability\n";
    }
  }
}

// FILE.png for one scene; FILE-1.png, FILE-2.png, ... for several.
std::string PictureFile(const std::string& file, int index, size_t count) {
  if (count == 1) return file;
  const size_t dot = file.find_last_of('.');
  const size_t slash = file.find_last_of('/');
  const bool extension = dot != std::string::npos && (slash == std::string::npos || dot > slash);
  const std::string stem = extension ? file.substr(0, dot) : file;
  return absl::StrCat(stem, "-", index + 1, extension ? file.substr(dot) : "");
}

// Draws each scenario that was answered. True if all went well.
bool DrawAll(const std::vector<v1::Scenario>& scenarios, const Predictions& predictions,
             double horizon, const std::string& model_version, const PredictArguments& arguments,
             const ActionTitles& titles, Environment& environment) {
  plot::ScenePlotOptions options;
  options.min_probability = !arguments.actions.empty() || arguments.top_k
                                ? 0.0
                                : arguments.min_probability.value_or(0.05);
  options.frame = Query(arguments).frame();
  options.horizon = horizon;
  options.lane_paths = arguments.paths;
  options.model_version = model_version;
  for (int id = 0; id < titles.size(); ++id) options.labels[id] = titles[id];
  bool all_drawn = true;
  for (const v1::ScenarioPrediction& prediction : predictions) {
    if (prediction.has_error()) continue;
    const int index = prediction.scenario_index();
    if (index < 0 || index >= static_cast<int>(scenarios.size())) continue;
    const std::string file = PictureFile(*arguments.plot, index, scenarios.size());
    const absl::StatusOr<std::string> picture =
        plot::DrawScene(scenarios[static_cast<size_t>(index)], prediction, options);
    const absl::Status status = picture.ok() ? WriteFile(file, *picture) : picture.status();
    if (status.ok()) {
      environment.err << "the picture is " << file << "\n";
    } else {
      environment.Fail(status);
      all_drawn = false;
    }
  }
  return all_drawn;
}

// A request with the scenes as they were at the prediction time: the rest is not sent.
template <typename Request>
Request MakeRequest(const PredictArguments& arguments, const std::vector<v1::Scenario>& scenarios) {
  Request request;
  request.set_model(ModelResource(arguments.model));
  request.set_priority(PriorityNamed(arguments.priority));
  request.set_include_action_names(true);
  request.set_strict(arguments.strict);
  request.mutable_required_action_names()->Add(arguments.required_names.begin(),
                                               arguments.required_names.end());
  for (const v1::Scenario& scenario : scenarios) {
    v1::Scenario* observed = request.add_scenarios();
    *observed = scenario;
    client::StripFuture(observed);
  }
  return request;
}

int Probability(const PredictArguments& arguments, Environment& environment) {
  const auto scenarios = ReadScenarios(arguments.files, environment);
  if (!scenarios.ok()) return environment.Refuse(std::string(scenarios.status().message()));
  const auto answer = environment.server_client().PredictActionProbabilities(
      MakeRequest<v1::PredictActionProbabilitiesRequest>(arguments, *scenarios),
      Options(arguments, environment));
  if (!answer.ok()) return environment.FailCall(answer.status());
  if (environment.json()) {
    environment.PrintJson(*answer);
  } else if (HasAnswers(answer->predictions())) {
    PrintProbabilities(answer->predictions(), arguments.at_least, answer->action_names(),
                       environment);
  }
  return ReportItems(answer->predictions(), environment) ? kOk : kFailed;
}

// Prints and draws what distribution and predict have in common.
template <typename Answer>
int Finish(const PredictArguments& arguments, const std::vector<v1::Scenario>& scenarios,
           const Answer& answer, Environment& environment) {
  const double horizon = answer.waypoint_times().empty() ? 0.0 : *answer.waypoint_times().rbegin();
  if (environment.json()) {
    environment.PrintJson(answer);
  } else if (HasAnswers(answer.predictions())) {
    PrintDistributions(answer.predictions(), horizon, arguments.frame, answer.action_names(),
                       environment);
    if (arguments.representatives) {
      PrintRepresentatives(answer.predictions(), horizon, arguments.frame, answer.action_names(),
                           environment);
    }
    if (arguments.joint) PrintJoint(answer.predictions(), answer.action_names(), environment);
  }
  ReportJoint(answer.predictions(), environment);
  bool all_well = ReportItems(answer.predictions(), environment);
  if (arguments.plot) {
    all_well &= DrawAll(scenarios, answer.predictions(), horizon, answer.model_version(), arguments,
                        answer.action_names(), environment);
  }
  return all_well ? kOk : kFailed;
}

int Distribution(const PredictArguments& arguments, Environment& environment) {
  const auto scenarios = ReadScenarios(arguments.files, environment);
  if (!scenarios.ok()) return environment.Refuse(std::string(scenarios.status().message()));
  auto request = MakeRequest<v1::PredictActionDistributionsRequest>(arguments, *scenarios);
  *request.mutable_query() = Query(arguments);
  const auto answer = environment.server_client().PredictActionDistributions(
      request, Options(arguments, environment));
  if (!answer.ok()) return environment.FailCall(answer.status());
  return Finish(arguments, *scenarios, *answer, environment);
}

int Predict(const PredictArguments& arguments, Environment& environment) {
  const auto scenarios = ReadScenarios(arguments.files, environment);
  if (!scenarios.ok()) return environment.Refuse(std::string(scenarios.status().message()));
  auto request = MakeRequest<v1::PredictRequest>(arguments, *scenarios);
  *request.mutable_query() = Query(arguments);
  const auto answer = environment.server_client().Predict(request, Options(arguments, environment));
  if (!answer.ok()) return environment.FailCall(answer.status());
  if (!environment.json() && HasAnswers(answer->predictions())) {
    PrintProbabilities(answer->predictions(), arguments.at_least, answer->action_names(),
                       environment);
    environment.out << "\n";
  }
  return Finish(arguments, *scenarios, *answer, environment);
}

void AddCommonOptions(Command& command, PredictArguments* arguments) {
  command.Arguments("FILE", &arguments->files, "Scenario as proto3 JSON; - for standard input");
  command.Option(
      "--model", &arguments->model,
      "town (the version that serves), town/2 or town@candidate [the only one that serves]");
  command.Option("--deadline", &arguments->deadline, 1.0, 1e7, "Most milliseconds for the answer");
  AddPriorityOption(command, &arguments->priority);
  AddRequireNameOption(command, &arguments->required_names);
  AddStrictOption(command, &arguments->strict);
}

void AddQueryOptions(Command& command, PredictArguments* arguments) {
  command.Option("--actions", &arguments->actions, 0, INT32_MAX,
                 "Describe these actions, such as 1,2");
  command.Option("--min-probability", &arguments->min_probability, 0.0, 1.0,
                 "Describe actions at least this probable [0.05]");
  command.Option("--top-k", &arguments->top_k, 1, 1'000'000,
                 "Describe the k most probable actions");
  command.Exclude("--actions", "--min-probability");
  command.Exclude("--actions", "--top-k");
  command.Exclude("--top-k", "--min-probability");
  command.Option("--representatives", &arguments->representatives, 1, 1'000'000,
                 "Choose and describe this many actions that cover the mixture; the first is the "
                 "medoid, the best single answer");
  command.Option("--joint", &arguments->joint, 1, 64,
                 "Find this many combinations of the targets' actions, without collisions; at most "
                 "8 targets");
  command.Flag("--prior", &arguments->prior,
               "Describe generic actions, p(z|y), instead of actions in this scene");
  command.Choice("--frame", &arguments->frame, {"world", "target"}, "Frame of the trajectories");
  command.Picture("--plot", &arguments->plot,
                  "PNG file to draw the scene into; FILE-1.png, ... for several scenes");
  command.Flag("--paths", &arguments->paths, "Also draw the lane paths of each target");
  command.Need("--paths", "--plot");
}

}  // namespace

void AddPredict(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<PredictArguments>();
  Command probability =
      root.Add("probability", "How probable is each action?",
               "p(y|s) for each target of each scene, most probable first. A "
               "scene or target that is refused\n"
               "is reported; the others are answered, and the exit status is 1.\n"
               "Example: maneuver scenario extract town town-1-0 -o scene.json\n"
               "         maneuver probability scene.json --model town\n"
               "         maneuver probability scene.json --require-name \"brake hard\"");
  AddCommonOptions(probability, arguments.get());
  probability.Option("--at-least", &arguments->at_least, 0.0, 1.0,
                     "Sum up less probable actions in one line");
  probability.Run([=, &environment] { return Probability(*arguments, environment); });

  Command distribution = root.Add(
      "distribution", "What would an action look like here?",
      "q(z|y,s) decoded: where each target would go if it took the action. The table shows the "
      "last\n"
      "waypoint; --output json has all of them, with sigma trajectories and covariances.\n"
      "Example: maneuver distribution scene.json --top-k 3 --plot scene.png\n"
      "         maneuver distribution scene.json --actions 4,11 --frame target --output json");
  AddCommonOptions(distribution, arguments.get());
  AddQueryOptions(distribution, arguments.get());
  distribution.Run([=, &environment] { return Distribution(*arguments, environment); });

  Command predict =
      root.Add("predict", "Probabilities and distributions of actions",
               "Example: maneuver predict scene.json --plot scene.png\n"
               "         maneuver predict scene.json --representatives 6 --plot scene.png\n"
               "         maneuver predict scene.json --joint 6 --plot scene.png\n"
               "         maneuver predict *.json --model town@candidate --output json");
  AddCommonOptions(predict, arguments.get());
  AddQueryOptions(predict, arguments.get());
  predict.Option("--at-least", &arguments->at_least, 0.0, 1.0,
                 "Sum up less probable actions in one line");
  predict.Run([=, &environment] { return Predict(*arguments, environment); });
}

}  // namespace maneuver::cli
