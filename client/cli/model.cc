// maneuver model: list, show, actions, delete, promote, unalias, label; compare, export, transfer
// and report are in model_compare.cc, model_export.cc, model_transfer.cc and report.cc.

#include <cmath>
#include <memory>
#include <ostream>
#include <tuple>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/cli/action_gallery.h"
#include "client/cli/action_titles.h"
#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/json_files.h"
#include "client/cli/model_compare.h"
#include "client/cli/model_export.h"
#include "client/cli/model_transfer.h"
#include "client/cli/report.h"
#include "client/cli/resource_names.h"
#include "client/cli/rival_option.h"
#include "client/cli/spec_rows.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/plot/action_set_plot.h"

namespace maneuver::cli {
namespace {

struct ModelArguments {
  std::string model;
  std::string alias = "serving";
  std::vector<std::string> ahead_of;
  std::vector<std::string> not_behind;
  std::optional<std::string> dataset;
  int64_t action = 0;
  std::string label;
  bool all = false;
  std::optional<double> speed;
  std::optional<std::string> plot;
};

double Horizon(const v1::ModelSpec& spec) {
  return spec.trajectory().waypoints() * ToSeconds(spec.trajectory().waypoint_interval());
}

std::string Metric(const v1::ModelManifest& manifest, const std::string& name) {
  const auto found = manifest.metrics().find(name);
  return found == manifest.metrics().end() ? "-" : Fixed(found->second, 2);
}

int ListModels(const std::string& model, Environment& environment) {
  v1::ListModelVersionsRequest request;
  request.set_parent(model.empty() ? "models/-" : ModelResource(model));
  request.set_page_size(1'000);
  v1::ListModelVersionsResponse all;
  do {
    auto page = environment.server_client().ListModelVersions(request, environment.call_options());
    if (!page.ok()) return environment.FailCall(page.status());
    request.set_page_token(page->next_page_token());
    page->clear_next_page_token();
    all.MergeFrom(*page);
  } while (!request.page_token().empty());
  if (!model.empty() && all.model_versions().empty()) {
    return environment.Fail(absl::NotFoundError(absl::StrCat(
        "there is no version of ", model, "; maneuver model list shows those of all models")));
  }
  if (environment.json()) {
    environment.PrintJson(all);
    return kOk;
  }
  Table table({{"MODEL"},
               {"ALIASES"},
               {"CREATED"},
               {"ACTIONS", Align::kRight},
               {"HORIZON", Align::kRight},
               {"ADE 1", Align::kRight},
               {"MIN ADE 6", Align::kRight},
               {"DATASETS"}});
  for (const v1::ModelVersion& version : all.model_versions()) {
    const v1::ModelManifest& manifest = version.manifest();
    std::vector<std::string> datasets;
    for (const std::string& dataset : manifest.provenance().datasets()) {
      datasets.push_back(ShortName(dataset));
    }
    table.Add({ShortName(version.name()), absl::StrJoin(version.aliases(), " "),
               Moment(version.create_time()), absl::StrCat(manifest.spec().actions()),
               ExactSeconds(Horizon(manifest.spec())), Metric(manifest, "ade_1"),
               Metric(manifest, "min_ade_6"), absl::StrJoin(datasets, " ")});
  }
  if (table.empty()) {
    environment.err << "no models yet; train one with maneuver train MODEL --dataset NAME\n";
  } else {
    environment.out << table.Text(environment.color);
  }
  return kOk;
}

// "unseen (1200 examples, 2026-02-03 14:05:06)", one for each dataset; "-" without any.
absl::StatusOr<std::string> EvaluatedOn(const std::string& version, Environment& environment) {
  const auto reports = ListReports(version, environment);
  if (!reports.ok()) return reports.status();
  std::vector<std::string> texts;
  for (const v1::EvaluationReport& report : *reports) {
    texts.push_back(absl::StrCat(ShortName(report.dataset()), " (", report.examples(),
                                 " examples, ", Moment(report.create_time()), ")"));
  }
  return texts.empty() ? "-" : absl::StrJoin(texts, ", ");
}

// What each of the servers that predict has loaded of a version's model: "candidate 4, serving 3".
Table ReplicaTable(const v1::ListReplicasResponse& replicas, const std::string& version) {
  const std::string model = version.substr(0, version.find("/versions/") + 1);
  Table table({{"REPLICA"}, {"LOADED"}});
  for (const v1::Replica& replica : replicas.replicas()) {
    if (replica.role() != v1::REPLICA_ROLE_ALL && replica.role() != v1::REPLICA_ROLE_SERVE)
      continue;
    std::vector<std::string> loaded;
    for (const v1::ModelAlias& alias : replica.loaded()) {
      if (!alias.name().starts_with(model)) continue;
      const auto last_word = [](const std::string& name) {
        return name.substr(name.rfind('/') + 1);
      };
      loaded.push_back(
          absl::StrCat(last_word(alias.name()), " ", last_word(alias.model_version())));
    }
    table.Add({replica.name(), loaded.empty() ? "-" : absl::StrJoin(loaded, ", ")});
  }
  return table;
}

// Between which values the inputs of the held-out examples lie; empty if the manifest does not say.
std::string InputsText(const v1::ModelManifest& manifest) {
  std::vector<std::string> texts;
  for (const auto& [name, unit, digits] :
       {std::tuple("speed", " m/s", 1), {"agents", " agents", 0}, {"map", " map features", 0}}) {
    const auto found = manifest.input_ranges().find(name);
    if (found == manifest.input_ranges().end()) continue;
    texts.push_back(absl::StrCat(Fixed(found->second.low(), digits), " to ",
                                 Fixed(found->second.high(), digits), unit));
  }
  return absl::StrJoin(texts, ", ");
}

int ShowModel(const std::string& name, Environment& environment) {
  v1::GetModelVersionRequest request;
  request.set_name(ModelResource(name));
  const auto version =
      environment.server_client().GetModelVersion(request, environment.call_options());
  if (!version.ok()) return environment.FailCall(version.status());
  if (environment.json()) {
    environment.PrintJson(*version);
    return kOk;
  }
  const auto evaluated = EvaluatedOn(version->name(), environment);
  if (!evaluated.ok()) return environment.FailCall(evaluated.status());
  const v1::ModelManifest& manifest = version->manifest();
  const v1::ModelSpec& spec = manifest.spec();
  int effective = 0;
  for (const v1::Action& action : manifest.actions()) effective += action.effective() ? 1 : 0;
  Table table({{"MODEL"}, {ShortName(version->name())}});
  table.Add({"aliases", absl::StrJoin(version->aliases(), " ")});
  table.Add({"created", Moment(version->create_time())});
  table.Add({"actions", absl::StrCat(spec.actions(), ", ", effective, " effective")});
  table.Add({"latent dimensions", absl::StrCat(spec.latent_dimensions())});
  table.Add({"horizon", absl::StrCat(ExactSeconds(Horizon(spec)), " in ",
                                     spec.trajectory().waypoints(), " waypoints")});
  AddSpecRows(spec, version->cost(), &table);
  table.Add({"datasets", absl::StrJoin(manifest.provenance().datasets(), " ")});
  if (!manifest.provenance().start_from().empty()) {
    table.Add({"started from", ShortName(manifest.provenance().start_from())});
  }
  table.Add({"preset", manifest.provenance().settings().preset()});
  table.Add({"examples", absl::StrCat(manifest.provenance().training_examples(), " learned, ",
                                      manifest.provenance().validation_examples(), " held out")});
  if (const std::string inputs = InputsText(manifest); !inputs.empty()) {
    table.Add({"held-out inputs", inputs});
  }
  table.Add({"evaluated on", *evaluated});
  environment.out << table.Text(environment.color);
  // A server of before has no such call, and a caller may lack the role.
  const auto replicas = environment.server_client().ListReplicas({}, environment.call_options());
  if (replicas.ok() && !replicas->replicas().empty()) {
    environment.out << "\n" << ReplicaTable(*replicas, version->name()).Text(environment.color);
  }
  if (manifest.metrics_size() > 0) {
    environment.out << "\n" << HeldOutText(manifest, environment.color);
  }
  return kOk;
}

// What an action does, in a few numbers: where it ends, in the target's frame.
std::string Ends(const v1::Trajectory& mean) {
  if (mean.x().empty() || mean.y().empty()) return "-";
  const double x = *mean.x().rbegin();
  const double y = *mean.y().rbegin();
  return absl::StrCat(Fixed(x, 1), " m ahead, ", Fixed(std::abs(y), 1), " m ",
                      y >= 0.0 ? "left" : "right");
}

// One panel for each action; or, of actions that differ by speed where none is asked for, a
// gallery.
absl::StatusOr<std::string> DrawActions(const v1::ActionSet& set, const ModelArguments& arguments,
                                        Environment& environment) {
  if (!set.has_speed() || arguments.speed) {
    plot::ActionSetPlotOptions options;
    options.all = arguments.all;
    return plot::DrawActionSet(set, options);
  }
  plot::ActionGalleryOptions options;
  options.all = arguments.all;
  return DrawGallery(set.model_version(), options, environment);
}

int Actions(const ModelArguments& arguments, Environment& environment) {
  v1::GetActionSetRequest request;
  request.set_name(ModelResource(arguments.model));
  if (arguments.speed) request.set_speed(*arguments.speed);
  const auto set = environment.server_client().GetActionSet(request, environment.call_options());
  if (!set.ok()) return environment.FailCall(set.status());
  if (arguments.plot) {
    const absl::StatusOr<std::string> picture = DrawActions(*set, arguments, environment);
    const absl::Status status =
        picture.ok() ? WriteFile(*arguments.plot, *picture) : picture.status();
    if (!status.ok()) return environment.FailCall(status);
    environment.err << "the picture is " << *arguments.plot << "\n";
  }
  if (environment.json()) {
    environment.PrintJson(*set);
    return kOk;
  }
  Table table({{"ACTION", Align::kRight}, {"NAME"}, {"USAGE", Align::kRight}, {"MEAN ENDS"}});
  int left_out = 0;
  for (const v1::Action& action : set->actions()) {
    if (!action.effective() && !arguments.all) {
      ++left_out;
      continue;
    }
    table.Add({absl::StrCat(action.action_id()), action.display_name(), Share(action.usage()),
               Ends(action.distribution().mean_trajectory())});
  }
  environment.out << table.Text(environment.color);
  if (set->has_speed()) {
    environment.err << "means are for a target that drives straight on at " << set->speed()
                    << " m/s; --speed sets another speed\n";
  } else if (arguments.speed) {
    environment.err << "the actions of this model are the same at every speed\n";
  }
  if (left_out > 0) {
    environment.err << left_out << " actions are not effective; --all shows them too\n";
  }
  return kOk;
}

// Whether a name is that of one version, such as models/town/versions/2.
bool IsVersion(const std::string& resource) {
  return resource.find("/versions/") != std::string::npos;
}

int RefuseModel(const std::string& purpose, const std::string& name, Environment& environment) {
  return environment.Refuse(absl::StrCat("name the version to ", purpose, ", such as ",
                                         name.substr(0, name.find('@')),
                                         "/2; see maneuver model list"));
}

int DeleteModel(const std::string& name, Environment& environment) {
  v1::DeleteModelVersionRequest request;
  request.set_name(ModelResource(name));
  if (!IsVersion(request.name())) return RefuseModel("delete", name, environment);
  const absl::Status status =
      environment.server_client().DeleteModelVersion(request, environment.call_options());
  if (!status.ok()) return environment.FailCall(status);
  environment.err << request.name() << " is deleted\n";
  return kOk;
}

absl::StatusOr<v1::ModelVersion> Version(const std::string& name, Environment& environment) {
  v1::GetModelVersionRequest request;
  request.set_name(name);
  return environment.server_client().GetModelVersion(request, environment.call_options());
}

// Says which action of the version before is which of the version after, for callers that go by
// ids. Says nothing if it is the same version, or cannot be had: the alias has moved all the same.
void PrintMovedActions(const v1::ModelVersion& before, const std::string& after,
                       Environment& environment) {
  if (before.name() == after) return;
  const auto version = Version(after, environment);
  if (!version.ok()) return;
  environment.out << "\nWhat its actions are now:\n\n"
                  << ActionMappingText(before, *version, environment.color);
}

int Promote(const ModelArguments& arguments, Environment& environment) {
  const std::string version = ModelResource(arguments.model);
  if (!IsVersion(version)) return RefuseModel("promote", arguments.model, environment);
  v1::SetModelAliasRequest request;
  request.set_name(
      absl::StrCat(version.substr(0, version.find("/versions/")), "/aliases/", arguments.alias));
  request.set_model_version(version);
  absl::Status required = ParseRequirements(arguments.ahead_of, v1::RIVAL_STANDARD_AHEAD,
                                            "--ahead-of", request.mutable_requirements());
  required.Update(ParseRequirements(arguments.not_behind, v1::RIVAL_STANDARD_NOT_BEHIND,
                                    "--not-behind", request.mutable_requirements()));
  if (!required.ok()) return environment.Refuse(std::string(required.message()));
  if (!request.requirements().empty() && !arguments.dataset) {
    return environment.Refuse(
        "--ahead-of and --not-behind need --dataset, which names the evaluation to check");
  }
  if (request.requirements().empty() && arguments.dataset) {
    return environment.Refuse(
        "--dataset needs --ahead-of or --not-behind, which say what its evaluation must meet");
  }
  if (arguments.dataset) request.set_dataset(DatasetResource(*arguments.dataset));
  // For the table of what became of its actions.
  absl::StatusOr<v1::ModelVersion> before = absl::NotFoundError("not asked for");
  if (!environment.json()) {
    before =
        Version(absl::StrCat(version.substr(0, version.find("/versions/")), "@", arguments.alias),
                environment);
  }
  const auto alias = environment.server_client().SetModelAlias(request, environment.call_options());
  if (!alias.ok()) return environment.FailCall(alias.status());
  if (environment.json()) {
    environment.PrintJson(*alias);
    return kOk;
  }
  environment.out << alias->name() << " is now " << alias->model_version() << "\n";
  if (before.ok()) PrintMovedActions(*before, alias->model_version(), environment);
  return kOk;
}

int RemoveAlias(const std::string& name, Environment& environment) {
  const std::vector<std::string> halves =
      absl::StrSplit(absl::StrReplaceAll(ModelResource(name), {{"@", "/aliases/"}}), "/aliases/");
  if (halves.size() != 2) {
    return environment.Refuse(
        "name the alias to remove, such as town@candidate; see maneuver model list");
  }
  v1::ModelAlias alias;
  alias.set_name(absl::StrJoin(halves, "/aliases/"));
  // With it the alias can be set again.
  const auto before = Version(absl::StrJoin(halves, "@"), environment);
  if (before.ok()) alias.set_model_version(before->name());
  v1::DeleteModelAliasRequest request;
  request.set_name(alias.name());
  const absl::Status status =
      environment.server_client().DeleteModelAlias(request, environment.call_options());
  if (!status.ok()) return environment.FailCall(status);
  if (environment.json()) {
    environment.PrintJson(alias);
  } else {
    environment.out << alias.name() << " is removed"
                    << (before.ok() ? "; it was " + alias.model_version() : "") << "\n";
  }
  if (halves[1] == "serving") {
    const std::string model = ShortName(halves[0]);
    environment.err << "no version of " << model << " serves now; maneuver model promote "
                    << (before.ok() ? ShortName(alias.model_version()) : model + "/VERSION")
                    << " makes one serve\n";
  }
  return kOk;
}

int Label(const ModelArguments& arguments, Environment& environment) {
  v1::LabelActionRequest request;
  request.set_name(ModelResource(arguments.model));
  if (!IsVersion(request.name())) {  // labels are kept with a version: the one that this is now
    v1::GetModelVersionRequest named;
    named.set_name(request.name());
    const auto version =
        environment.server_client().GetModelVersion(named, environment.call_options());
    if (!version.ok()) return environment.FailCall(version.status());
    request.set_name(version->name());
  }
  request.set_action_id(static_cast<int32_t>(arguments.action));
  request.set_label(arguments.label);
  const auto action = environment.server_client().LabelAction(request, environment.call_options());
  if (!action.ok()) return environment.FailCall(action.status());
  if (environment.json()) {
    environment.PrintJson(*action);
  } else {
    environment.out << "action " << action->action_id() << " of " << ShortName(request.name())
                    << (action->label().empty() ? " has no label now"
                                                : " is now \"" + Printable(action->label()) + "\"")
                    << "\n";
  }
  return kOk;
}

}  // namespace

void AddModel(Command& root, Environment& environment) {
  Command group = root.Add("model", "Trained models and their actions");
  const auto arguments = std::make_shared<ModelArguments>();
  const std::string any = "town (the version that serves), town/2 or town@candidate";

  Command list = group.Add("list", "All versions, newest first",
                           "Example: maneuver model list\n"
                           "         maneuver model list town");
  list.OptionalArgument("MODEL", &arguments->model, "Show only versions of this model");
  list.Run([=, &environment] { return ListModels(arguments->model, environment); });

  Command show = group.Add("show", "One version", "Example: maneuver model show town/2");
  show.Argument("MODEL", &arguments->model, any);
  show.Run([=, &environment] { return ShowModel(arguments->model, environment); });

  Command actions = group.Add("actions", "Show the actions of a version",
                              "Actions of a model that predicts relative to the present motion "
                              "depend on the speed: --plot draws them at 0, 5, 10 and 20 m/s, or "
                              "at --speed.\n"
                              "Example: maneuver model actions town --plot actions.png\n"
                              "         maneuver model actions town --speed 10");
  actions.OptionalArgument("MODEL", &arguments->model, any + " [the only one that serves]");
  actions.Flag("--all", &arguments->all, "Include actions that are not effective");
  actions.Option("--speed", &arguments->speed, 0.0, 100.0,
                 "Target speed for which to draw them, m/s [10]");
  actions.Picture("--plot", &arguments->plot, "PNG file to draw them into");
  actions.Run([=, &environment] { return Actions(*arguments, environment); });

  Command remove = group.Add("delete", "Remove a version",
                             "Refused while an alias points to it: see maneuver model "
                             "unalias.\n"
                             "Example: maneuver model delete town/1");
  remove.Argument("MODEL", &arguments->model, "The version, such as town/1");
  remove.Run([=, &environment] { return DeleteModel(arguments->model, environment); });

  Command promote = group.Add("promote", "Make a version serve",
                              "The version is loaded and checked first. Nothing changes if that "
                              "fails, or if its last evaluation on --dataset does not meet "
                              "--ahead-of and --not-behind; the answer names the strata.\n"
                              "Example: maneuver model promote town/2\n"
                              "         maneuver model promote town/3 --alias candidate\n"
                              "         maneuver model promote town/3 --dataset unseen \\\n"
                              "             --ahead-of cv --not-behind ctra@strata");
  promote.Argument("MODEL", &arguments->model, "The version, such as town/2");
  promote.Option("--alias", &arguments->alias, "Alias to point to the version");
  promote.Option("--dataset", &arguments->dataset,
                 "Dataset that the version was evaluated on, for --ahead-of and --not-behind");
  promote.Option("--ahead-of", &arguments->ahead_of,
                 absl::StrCat("Require that the version is ahead of this by the whole 95 % "
                              "interval of the difference; may be repeated. ",
                              kRivalHelp));
  promote.Option(
      "--not-behind", &arguments->not_behind,
      "Require that the version is not behind this by the whole interval; undecided is enough");
  promote.Run([=, &environment] { return Promote(*arguments, environment); });

  Command unalias =
      group.Add("unalias", "Remove an alias",
                "The version that it points to stays. Callers who name the alias, or the model if "
                "the alias is `serving`, are refused until it points to a version again. Removing "
                "`candidate` ends the shadow.\n"
                "Example: maneuver model unalias town@candidate");
  unalias.Argument("ALIAS", &arguments->model, "The alias, such as town@candidate");
  unalias.Run([=, &environment] { return RemoveAlias(arguments->model, environment); });

  AddModelCompare(group, environment);
  AddModelTransfer(group, environment);
  AddModelExport(group, environment);
  AddModelReport(group, environment);

  Command label =
      group.Add("label", "Name an action", "Example: maneuver model label town/2 7 \"left turn\"");
  label.Argument("MODEL", &arguments->model, any);
  label.Argument("ACTION", &arguments->action, 0, 1'000'000, "The action's id");
  label.Argument("LABEL", &arguments->label, "Its name; \"\" removes it");
  label.Run([=, &environment] { return Label(*arguments, environment); });
}

}  // namespace maneuver::cli
