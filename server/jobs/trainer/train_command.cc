#include "server/jobs/trainer/train_command.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <iostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/artifact/model_cost.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/cost_text.h"
#include "model/evaluation/report_text.h"
#include "model/learning/trainer.h"
#include "server/jobs/trainer/data_memory_option.h"
#include "server/jobs/trainer/dataset_measurement.h"
#include "server/jobs/trainer/dataset_names.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/number_checks.h"
#include "server/jobs/trainer/progress_display.h"
#include "server/jobs/trainer/rank_launcher.h"
#include "server/jobs/trainer/settings_file.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {
namespace {

// The least time that the ranks of one machine have to start. A busy machine needs some of it.
constexpr std::chrono::milliseconds kLocalStart{60'000};

// The violations in one message; OK if there are none.
absl::Status Refuse(const std::vector<scene::FieldViolation>& violations) {
  std::string message;
  for (const scene::FieldViolation& violation : violations) {
    absl::StrAppend(&message, message.empty() ? "settings: " : "; ", violation.field, " ",
                    violation.description);
    if (violation.others > 0) absl::StrAppend(&message, "; and ", violation.others, " more");
  }
  return message.empty() ? absl::OkStatus() : absl::InvalidArgumentError(message);
}

void PrintCost(const v1::ModelSpec& spec) {
  const v1::ModelCost cost = artifact::CountCost(spec);
  if (spec.has_raster()) {
    std::cout << "backbone: " << evaluation::BackboneCostText(cost) << "\n";
  }
  std::cout << "whole model: " << evaluation::ModelCostText(cost) << std::endl;
}

void PrintMetrics(const v1::ModelManifest& manifest) {
  if (manifest.metrics().empty()) {
    std::cout << "No recording was held out, so nothing was measured.\n";
    return;
  }
  v1::EvaluationReport report;
  *report.mutable_metrics() = manifest.metrics();
  *report.mutable_rivals() = manifest.rivals();
  std::cout << "On " << manifest.provenance().validation_examples() << " held-out examples:\n\n"
            << evaluation::ReportText(report, PrintsBold());
}

}  // namespace

TrainCommand::TrainCommand(CLI::App& app)
    : command_(app.add_subcommand("train", "Learn a model from dataset folders")) {
  command_
      ->add_option("--settings", settings_,
                   "TrainingSettings as JSON; without it, the preset lanes")
      ->type_name("FILE");
  command_->add_option("--dataset", datasets_, "Dataset folders to learn from")
      ->type_name("FOLDER")
      ->required();
  command_->add_option("--output", output_, "Model folder to write; it must not exist")
      ->type_name("FOLDER")
      ->required();
  command_
      ->add_option("--dataset-name", dataset_names_,
                   "Names of the datasets for the model's provenance (default: the folders')")
      ->type_name("NAME");
  command_
      ->add_option("--start-from", start_from_,
                   "Model folder to start from instead of random weights: keeps its sizes and "
                   "actions, and runs only the joint and posterior epochs")
      ->type_name("FOLDER");
  command_
      ->add_option("--start-from-name", start_from_name_,
                   "Its name for the model's provenance (default: the folder's)")
      ->type_name("NAME");
  command_
      ->add_option("--checkpoints", checkpoints_,
                   "Folder to keep checkpoints in; a run that finds its own there goes on from the "
                   "latest one")
      ->type_name("FOLDER");
  command_
      ->add_option("--checkpoint-interval", checkpoint_interval_,
                   "Least number of seconds between two checkpoints")
      ->check(FiniteRange(0.0, 86400.0))
      ->capture_default_str()
      ->type_name("SECONDS");
  AddDataMemoryOption(*command_, &data_memory_);
  command_->add_flag("--baselines", baselines_,
                     "Also train a CoverNet-like and a MultiPath-like baseline, which every "
                     "evaluation then shows beside the model; takes about as long again");
  command_
      ->add_option("--checkpoint-steps", checkpoint_steps_,
                   "Also write a checkpoint after this many steps; 0: by time alone")
      ->check(CLI::Range(int64_t{0}, int64_t{1'000'000'000}))
      ->capture_default_str()
      ->type_name("N");
  command_
      ->add_option("--checkpoints-kept", checkpoints_kept_, "Number of latest checkpoints to keep")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str()
      ->type_name("N");
  command_
      ->add_option("--least-actions", least_actions_,
                   "Fail if the held-out examples use fewer actions than this")
      ->check(CLI::Range(0, 100'000))
      ->capture_default_str()
      ->type_name("N");
  command_
      ->add_option("--ranks", ranks_,
                   "Processes on this machine that learn the model together: 1, 2, 4, 8 and so on; "
                   "0: this process alone, or the rank that its environment states")
      ->check(CLI::IsMember({0, 1, 2, 4, 8, 16, 32, 64}))
      ->type_name("N");
  command_
      ->add_option(
          "--rank-timeout", rank_timeout_,
          "With several ranks: give up if another rank does not answer for this many seconds")
      ->check(FiniteRange(1.0, 86400.0))
      ->capture_default_str()
      ->type_name("SECONDS");
  const std::string next = "Of the evaluations that follow: ";
  command_->add_option("--next-model", next_model_, next + "folder of a model that is as fast")
      ->type_name("FOLDER");
  command_->add_option("--next-dataset", next_dataset_, next + "dataset folder")
      ->type_name("FOLDER");
  command_->add_option("--next-settings", next_settings_, next + "ExampleSettings as JSON")
      ->type_name("FILE");
  command_
      ->add_option("--next-count", next_count_,
                   "Evaluations that the caller runs next, which count as a part of this run in "
                   "its progress; tried out for a second at the start")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str()
      ->type_name("N");
  command_->add_option("--threads", threads_, "Threads; 0: the settings', or one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
  command_
      ->add_option("--progress", progress_,
                   "bar for people, json for programs (a JobProgress a line), or none")
      ->check(CLI::IsMember({"json", "bar", "none"}))
      ->capture_default_str();
}

int TrainCommand::Run(const std::vector<std::string>& arguments) const {
  if (ranks_ == 0) return ExitStatus(Train());
  std::vector<std::string> of_rank;
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == "--ranks") {
      ++i;  // and its value
    } else if (!arguments[i].starts_with("--ranks=")) {
      of_rank.push_back(arguments[i]);
    }
  }
  return RunRanks(ranks_, of_rank);
}

double TrainCommand::SecondsAfter() const {
  // Each evaluation is a process that starts as this one did, on one thread; loading LibTorch alone
  // takes half a second.
  const double start = static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
  v1::TrainingSettings settings;
  if (next_count_ == 0 || !ReadJson(next_settings_, settings.mutable_examples()).ok()) return 0.0;
  const absl::StatusOr<double> seconds =
      MeasuringSeconds(next_model_, next_dataset_, data_memory_,
                       artifact::ResolveTrainingSettings(settings).examples(), threads_);
  if (!seconds.ok()) return 0.0;  // what fails now will fail then, and say why
  return next_count_ * (start + *seconds);
}

absl::Status TrainCommand::Train() const {
  v1::TrainingSettings settings;
  if (!settings_.empty()) {
    if (absl::Status status = ReadJson(settings_, &settings); !status.ok()) return status;
  }
  learning::TrainingRun run;
  if (start_from_.empty()) {
    run.settings = artifact::ResolveTrainingSettings(settings);
  } else {
    const absl::StatusOr<v1::ModelManifest> start = artifact::ReadModelManifest(start_from_);
    if (!start.ok()) return OfFolder(start.status(), start_from_);
    absl::Status status = Refuse(artifact::ValidateStart(settings, start->spec()));
    if (!status.ok()) return status;
    run.settings = artifact::ResolveTrainingSettings(settings, start->spec());
    run.start_from = start_from_;
    run.start_from_name =
        start_from_name_.empty() ? start_from_.filename().string() : start_from_name_;
  }
  if (threads_ > 0) run.settings.set_threads(threads_);
  const absl::StatusOr<std::optional<learning::RankPlace>> rank =
      learning::FindRankPlace(learning::ReadEnvironment);
  if (!rank.ok()) return rank.status();
  run.rank = *rank;
  const bool leads = !run.rank || run.rank->rank == 0;
  run.rank_timeout = std::chrono::milliseconds(static_cast<int64_t>(1000.0 * rank_timeout_));
  // Ranks of one machine are started together, those of several perhaps not.
  if (run.rank && run.rank->local_ranks == run.rank->ranks) {
    run.rank_join_timeout = std::max(run.rank_timeout, kLocalStart);
  }
  absl::Status valid = Refuse(artifact::ValidateTrainingSettings(run.settings));
  if (!valid.ok()) return valid;
  if (std::error_code ignored; std::filesystem::exists(output_, ignored)) {
    // Another rank than 0 that was started again by itself, after rank 0 had written the model.
    if (!leads) return absl::OkStatus();
    return absl::AlreadyExistsError(absl::StrCat(output_.filename().string(), " exists already"));
  }
  if (absl::Status status = CheckDatasets(datasets_); !status.ok()) return status;
  if (leads) {
    if (absl::Status status = PrepareOutput(output_); !status.ok()) return status;
  }
  run.output = output_;
  run.baselines = baselines_ || run.settings.baselines();
  run.checkpoints = checkpoints_;
  run.data_memory = data_memory_;
  run.checkpoint_policy = {
      .interval = std::chrono::milliseconds(static_cast<int64_t>(1000.0 * checkpoint_interval_)),
      .steps = checkpoint_steps_,
      .kept = checkpoints_kept_};
  run.least_effective_actions = least_actions_;
  run.trainer_version = MANEUVER_VERSION;
  absl::StatusOr<std::vector<std::string>> names = DatasetNames(dataset_names_, datasets_);
  if (!names.ok()) return names.status();
  run.dataset_names = *std::move(names);
  run.stopped = StopRequested;
  if (leads) run.seconds_after = SecondsAfter();
  const ProgressDisplay::Style style =
      leads ? ProgressDisplay::ParseStyle(progress_) : ProgressDisplay::Style::kNone;
  if (style == ProgressDisplay::Style::kBar) PrintCost(run.settings.model());
  absl::StatusOr<v1::ModelManifest> manifest;
  double waiting = 0.0;
  {
    ProgressDisplay display(style, std::cout);
    run.progress = [&display, &waiting](const v1::JobProgress& progress) {
      display.Show(progress);
      if (progress.phase() == "joint") waiting = progress.waiting_fraction();
    };
    manifest = learning::Train(run, datasets_);
  }
  if (!manifest.ok()) return manifest.status();
  if (style == ProgressDisplay::Style::kBar) {
    std::cout << absl::StrFormat(
        "The steps of the joint phase waited for rasters %.1f %% of their time.\n",
        100.0 * waiting);
    PrintMetrics(*manifest);
  }
  return absl::OkStatus();
}

}  // namespace maneuver::trainer
