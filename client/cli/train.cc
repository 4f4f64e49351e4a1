// maneuver train: learn a new version of a model.

#include <memory>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/promotion_options.h"
#include "client/cli/report.h"
#include "client/cli/resource_names.h"
#include "client/cli/settings_argument.h"

namespace maneuver::cli {
namespace {

struct TrainArguments {
  std::string model;
  std::vector<std::string> datasets;
  std::optional<std::string> start_from;
  std::optional<int64_t> ranks;
  std::optional<std::string> preset;
  std::optional<std::string> objective;
  std::optional<std::string> settings_file;
  std::vector<std::string> assignments;
  std::optional<std::string> horizon;
  std::optional<std::string> targets;
  std::optional<int64_t> pretraining_epochs;
  std::optional<int64_t> mixture_epochs;
  std::optional<int64_t> epochs;
  std::optional<int64_t> actions;
  std::optional<int64_t> seed;
  std::optional<int64_t> priority;
  PromotionArguments promotion;
  ReportFiles report;
  bool detach = false;
  bool validate_only = false;
};

// The named options as FIELD=VALUE, then those of --set.
std::vector<std::string> Assignments(const TrainArguments& arguments) {
  std::vector<std::string> assignments;
  const auto add = [&](const char* field, const auto& value) {
    if (value) assignments.push_back(absl::StrCat(field, "=", *value));
  };
  add("preset", arguments.preset);
  add("model.objective", arguments.objective);
  add("model.target_types", arguments.targets);
  add("seed", arguments.seed);
  add("model.actions", arguments.actions);
  add("optimization.pretraining_epochs", arguments.pretraining_epochs);
  add("optimization.mixture_epochs", arguments.mixture_epochs);
  add("optimization.joint_epochs", arguments.epochs);
  assignments.insert(assignments.end(), arguments.assignments.begin(), arguments.assignments.end());
  return assignments;
}

// File first, then the named options, then --set; the horizon last, since it needs the interval.
absl::StatusOr<v1::TrainingSettings> Settings(const TrainArguments& arguments,
                                              Environment& environment) {
  auto settings = ReadSettings(arguments.settings_file, Assignments(arguments), environment);
  if (!settings.ok() || !arguments.horizon) return settings;
  absl::Status status = SetHorizon(*arguments.horizon, &*settings);
  if (!status.ok()) return status;
  return settings;
}

absl::Status SetPromotion(const PromotionArguments& arguments, v1::TrainRequest& request) {
  v1::Promotion promotion = v1::PROMOTION_UNSPECIFIED;
  std::optional<v1::PromotionCriteria> criteria;
  absl::Status status = ReadPromotion(arguments, &promotion, &criteria);
  request.set_promotion(promotion);
  if (criteria) *request.mutable_promotion_criteria() = *std::move(criteria);
  return status;
}

// NAME or NAME=WEIGHT each. What is wrong with them, empty if nothing is.
std::string SetDatasets(const TrainArguments& arguments, v1::TrainRequest& request) {
  auto& weights = *request.mutable_settings()->mutable_examples()->mutable_dataset_weights();
  bool weighted = false;
  std::vector<double> given;
  for (const std::string& text : arguments.datasets) {
    const size_t equals = text.find('=');
    request.add_datasets(DatasetResource(text.substr(0, equals)));
    double& weight = given.emplace_back(1.0);
    if (equals == std::string::npos) continue;
    weighted = true;
    if (!absl::SimpleAtod(text.substr(equals + 1), &weight) || !(weight > 0.0)) {
      return absl::StrCat(
          "--dataset is NAME or NAME=WEIGHT with a weight above 0, such as city=3; "
          "not ",
          text);
    }
  }
  if (weighted && !weights.empty()) {
    return "weights are given twice: with --dataset and as examples.dataset_weights";
  }
  if (weighted) weights.Assign(given.begin(), given.end());
  return "";
}

int Train(const TrainArguments& arguments, Environment& environment) {
  const absl::StatusOr<v1::TrainingSettings> settings = Settings(arguments, environment);
  if (!settings.ok()) return environment.Refuse(std::string(settings.status().message()));
  v1::TrainRequest request;
  request.set_model(ModelResource(arguments.model));
  *request.mutable_settings() = *settings;
  if (const std::string wrong = SetDatasets(arguments, request); !wrong.empty()) {
    return environment.Refuse(wrong);
  }
  if (arguments.start_from) request.set_start_from(ModelResource(*arguments.start_from));
  if (const absl::Status status = SetPromotion(arguments.promotion, request); !status.ok()) {
    return environment.Refuse(std::string(status.message()));
  }
  request.set_ranks(static_cast<int32_t>(arguments.ranks.value_or(0)));
  request.set_priority(static_cast<int32_t>(arguments.priority.value_or(0)));
  request.set_validate_only(arguments.validate_only);
  const absl::Status prepared =
      arguments.validate_only ? absl::OkStatus() : PrepareReport(arguments.report);
  if (!prepared.ok()) return environment.Refuse(std::string(prepared.message()));
  const auto job = environment.server_client().Train(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (arguments.validate_only) {
    PrintValid(*job, environment);
    return kOk;
  }
  const int watched =
      ShowStarted(*job, absl::StrCat("trains ", request.model()), arguments.detach, environment);
  if (watched == kFailed || !arguments.report.any()) return watched;
  const int reported = WriteReportOfWatched(job->name(), arguments.report, environment);
  return watched == kOk ? reported : watched;
}

}  // namespace

void AddTrain(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<TrainArguments>();
  Command command = root.Add(
      "train", "Train a new version of a model",
      "Starts a job on the server and shows its progress; Ctrl-C stops watching, not the job, and\n"
      "the exit status is then 130.\n"
      "Settings come from the preset, then --settings, then the options, then --set.\n"
      "Example: maneuver train town --dataset town\n"
      "         maneuver train city --dataset waymo-training --horizon 5s --epochs 20 \\\n"
      "             --set optimization.batch_size=128 --set model.decoder.hidden=256,256 --detach\n"
      "         maneuver train town --dataset town --promote if-no-worse --promote-dataset unseen\n"
      "         maneuver train town --dataset town --promote if-no-worse --promote-dataset unseen "
      "\\\n"
      "             --promote-ahead cv --promote-not-behind ctra@strata\n"
      "         maneuver train town --start-from town --dataset town --dataset new=3 --epochs 3\n"
      "         maneuver train town --dataset town --report report.html --curves curves.csv");
  command.Argument("MODEL", &arguments->model, "The model: a-z, 0-9 and -; need not exist");
  command.Option("--dataset", &arguments->datasets,
                 "Dataset to learn from; may be repeated and weighted as NAME=WEIGHT: city=3 and "
                 "highway=1 take three examples from city for each one from highway",
                 true);
  command.Option("--start-from", &arguments->start_from,
                 "Version to start from, such as town, town/2 or town@candidate: keeps its sizes "
                 "and actions, and runs only the joint and posterior epochs [random weights]");
  command.Option("--ranks", &arguments->ranks, 0, 64,
                 "Processes that learn the model together: 1, 2, 4, 8 and so on, with the same "
                 "weights for each number; 0: one process that learns alone");
  command.Option("--objective", &arguments->objective,
                 "base (actions alone), dual (then their fit to the scene) or unified (both "
                 "together) [unified]");
  command.Option(
      "--preset", &arguments->preset,
      "lanes (relative to the motion), lanes-metres, or the paper's: compact (small), paper (its "
      "sizes), resnet50 (and its backbone), literal (exactly as printed) [lanes]");
  command.Option("--settings", &arguments->settings_file,
                 "File with TrainingSettings as proto3 JSON");
  command.Option("--set", &arguments->assignments,
                 "FIELD=VALUE of TrainingSettings, such as optimization.learning_rate=5e-4; may be "
                 "repeated");
  command.Option("--horizon", &arguments->horizon, "How far to predict, such as 5s");
  command.Option("--targets", &arguments->targets,
                 "Types of agents to learn from and to predict: vehicle, pedestrian, cyclist or "
                 "other, or several, separated by commas [vehicle]");
  command.Option("--epochs", &arguments->epochs, 0, 100'000,
                 "Epochs of the joint phase, which trains everything");
  command.Option("--pretraining-epochs", &arguments->pretraining_epochs, 0, 100'000,
                 "Epochs of the plain VAE");
  command.Option("--mixture-epochs", &arguments->mixture_epochs, 0, 100'000,
                 "Epochs of the mixture alone");
  command.Option("--actions", &arguments->actions, 1, 10'000, "K, the number of actions");
  command.Option("--seed", &arguments->seed, 0, INT64_MAX, "Seed for all random choices");
  AddPromotionOptions(command, &arguments->promotion);
  command.Option("--priority", &arguments->priority, -100, 100,
                 "Jobs with a higher priority run first [0]");
  command.Option("--report", &arguments->report.page,
                 "HTML file to write when the job has ended: a page for a browser");
  AddCurveOptions(command, &arguments->report);
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  for (const char* file : {"--report", "--curves", "--tensorboard"}) {
    command.Exclude(file, "--detach");  // maneuver job report writes it later
  }
  command.Flag("--validate-only", &arguments->validate_only,
               "Check the request, say how much memory the job will take, start nothing; --output "
               "json shows every setting that a job would learn with");
  command.Run([arguments, &environment] { return Train(*arguments, environment); });
}

}  // namespace maneuver::cli
