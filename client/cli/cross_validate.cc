// maneuver cross-validate: measure settings, each recording by a model that did not learn from it.

#include <memory>
#include <utility>

#include "client/cli/commands.h"
#include "client/cli/job_display.h"
#include "client/cli/resource_names.h"
#include "client/cli/settings_argument.h"

namespace maneuver::cli {
namespace {

struct CrossValidateArguments {
  std::vector<std::string> datasets;
  std::vector<std::string> test_datasets;
  std::optional<std::string> preset;
  std::optional<std::string> settings_file;
  std::vector<std::string> assignments;
  int64_t folds = 5;
  std::vector<int64_t> seeds;
  std::optional<int64_t> fold_seed;
  bool baselines = false;
  std::optional<int64_t> priority;
  bool detach = false;
  bool validate_only = false;
};

// File first, then the named options, then --set.
absl::StatusOr<v1::TrainingSettings> Settings(const CrossValidateArguments& arguments,
                                              Environment& environment) {
  std::vector<std::string> assignments;
  if (arguments.preset) assignments.push_back("preset=" + *arguments.preset);
  if (arguments.baselines) assignments.emplace_back("baselines=true");
  assignments.insert(assignments.end(), arguments.assignments.begin(), arguments.assignments.end());
  return ReadSettings(arguments.settings_file, std::move(assignments), environment);
}

int CrossValidate(const CrossValidateArguments& arguments, Environment& environment) {
  v1::CrossValidateRequest request;
  const auto settings = Settings(arguments, environment);
  if (!settings.ok()) return environment.Refuse(std::string(settings.status().message()));
  *request.mutable_settings() = *settings;
  for (const std::string& name : arguments.datasets) request.add_datasets(DatasetResource(name));
  for (const std::string& name : arguments.test_datasets) {
    request.add_test_datasets(DatasetResource(name));
  }
  request.set_folds(static_cast<int32_t>(arguments.folds));
  request.mutable_seeds()->Add(arguments.seeds.begin(), arguments.seeds.end());
  if (arguments.fold_seed) request.set_fold_seed(*arguments.fold_seed);
  request.set_priority(static_cast<int32_t>(arguments.priority.value_or(0)));
  request.set_validate_only(arguments.validate_only);
  const auto job = environment.server_client().CrossValidate(request, environment.call_options());
  if (!job.ok()) return environment.FailCall(job.status());
  if (arguments.validate_only) {
    PrintValid(*job, environment);
    return kOk;
  }
  return ShowStarted(*job, "cross-validates", arguments.detach, environment);
}

}  // namespace

void AddCrossValidate(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<CrossValidateArguments>();
  Command command = root.Add(
      "cross-validate", "Measure training settings on whole datasets",
      "Starts a job on the server that trains folds x seeds models. Each recording is measured "
      "with models that did not learn from a recording of the same place or drive. The tables have "
      "means with 95 % intervals, and say where the model is ahead of other predictors. No version "
      "is made.\n"
      "maneuver job resume continues an interrupted job with the missing models.\n"
      "Example: maneuver cross-validate city --seeds 1,2,3 --baselines\n"
      "         maneuver cross-validate city --settings settings.json --test-dataset ngsim \\\n"
      "             --detach\n"
      "         maneuver job show 3f2a --output json");
  command.Arguments("DATASET", &arguments->datasets, "Datasets to learn from and to measure");
  command.Option("--settings", &arguments->settings_file,
                 "File with TrainingSettings as proto3 JSON");
  command.Option("--preset", &arguments->preset, "Preset, as for maneuver train [lanes]");
  command.Option("--set", &arguments->assignments,
                 "FIELD=VALUE of TrainingSettings, such as optimization.joint_epochs=20; may be "
                 "repeated");
  command.Option("--folds", &arguments->folds, 2, 100,
                 "Number of parts to divide the recordings into");
  command.Option(
      "--seeds", &arguments->seeds, 0, INT64_MAX,
      "Training seeds, such as 1,2,3; every fold is trained with each [the seed of the settings]");
  command.Option("--fold-seed", &arguments->fold_seed, 0, INT64_MAX,
                 "Seed of the division into folds [1]");
  command.Flag("--baselines", &arguments->baselines,
               "Also train a CoverNet-like and a MultiPath-like baseline in each fold; takes about "
               "twice as long");
  command.Option("--test-dataset", &arguments->test_datasets,
                 "Dataset to measure every model on, without learning from it; may be repeated");
  command.Option("--priority", &arguments->priority, -100, 100,
                 "Jobs with a higher priority run first [0]");
  command.Flag("--detach", &arguments->detach, "Start the job and return");
  command.Flag("--validate-only", &arguments->validate_only,
               "Check the request, say how much memory the job will take, start nothing");
  command.Run([arguments, &environment] { return CrossValidate(*arguments, environment); });
}

}  // namespace maneuver::cli
