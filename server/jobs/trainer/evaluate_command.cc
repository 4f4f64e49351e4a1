#include "server/jobs/trainer/evaluate_command.h"

#include <algorithm>
#include <chrono>
#include <iostream>
#include <utility>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/action_names.h"
#include "model/evaluation/report_text.h"
#include "model/learning/training_progress.h"
#include "server/jobs/trainer/data_memory_option.h"
#include "server/jobs/trainer/dataset_measurement.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/settings_file.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

EvaluateCommand::EvaluateCommand(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("evaluate", "Measure a model on recordings that it did not learn from");
  command->add_option("--model", model_, "Model folder")->type_name("FOLDER")->required();
  command->add_option("--dataset", dataset_, "Dataset folder; all of its recordings are measured")
      ->type_name("FOLDER")
      ->required();
  command->add_option("--output", output_, "EvaluationReport as JSON")->type_name("FILE");
  command
      ->add_option("--settings", settings_,
                   "ExampleSettings as JSON; what is left out is the preset's")
      ->type_name("FILE");
  command
      ->add_option("--sampled-examples", sampled_examples_,
                   "Number of examples that the report contains, for figures")
      ->check(CLI::Range(0, 1000))
      ->type_name("N");
  AddDataMemoryOption(*command, &data_memory_);
  command->add_option("--threads", threads_, "Threads; 0: one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
  command
      ->add_option("--progress", progress_,
                   "bar for people, json for programs (a JobProgress a line), or none")
      ->check(CLI::IsMember({"json", "bar", "none"}))
      ->capture_default_str();
}

int EvaluateCommand::Run() const { return ExitStatus(Evaluate()); }

absl::Status EvaluateCommand::Evaluate() const {
  const ProgressDisplay::Style style = ProgressDisplay::ParseStyle(progress_);
  if (style == ProgressDisplay::Style::kJson && output_.empty()) {
    return absl::InvalidArgumentError(
        "with --progress json standard output is for programs; say with --output where the report "
        "shall go");
  }
  v1::TrainingSettings settings;
  if (!settings_.empty()) {
    if (absl::Status status = ReadJson(settings_, settings.mutable_examples()); !status.ok()) {
      return status;
    }
  }
  if (!output_.empty()) {
    if (absl::Status status = PrepareOutput(output_); !status.ok()) return status;
  }
  const absl::StatusOr<v1::EvaluationReport> report =
      Measure(artifact::ResolveTrainingSettings(settings).examples(), style);
  if (!report.ok()) return report.status();
  if (style != ProgressDisplay::Style::kJson) {
    const absl::StatusOr<v1::ModelManifest> manifest = artifact::ReadModelManifest(model_);
    if (!manifest.ok()) return manifest.status();
    std::cout << report->examples() << " examples\n\n"
              << evaluation::ReportText(*report, PrintsBold(), evaluation::DisplayNames(*manifest));
  }
  return output_.empty() ? absl::OkStatus() : WriteJson(output_, *report);
}

absl::StatusOr<v1::EvaluationReport> EvaluateCommand::Measure(const v1::ExampleSettings& examples,
                                                              ProgressDisplay::Style style) const {
  ProgressDisplay display(style, std::cout);
  learning::TrainingProgress progress(
      {{"load", 1, 1, 1.0}, {"evaluate", 1, 100, 1.0}},
      [&display](const v1::JobProgress& each) { display.Show(each); },
      [] { return std::chrono::system_clock::now(); });
  progress.BeginPhase("load");
  const absl::StatusOr<DatasetMeasurement> measurement =
      DatasetMeasurement::Open(model_, dataset_, data_memory_);
  if (!measurement.ok()) return measurement.status();
  bool is_measuring = false;
  int64_t reported = 0;  // hundredths
  int64_t counted = 0;
  return measurement->Measure(examples, sampled_examples_, threads_,
                              [&](int64_t done, int64_t total) {
                                // Up to the first report, recordings were read.
                                if (!std::exchange(is_measuring, true)) {
                                  progress.BeginPhase("evaluate");
                                }
                                for (const int64_t now = 100 * done / std::max<int64_t>(1, total);
                                     reported < now; ++reported) {
                                  progress.Step(done - counted);
                                  counted = done;
                                }
                                return !StopRequested();
                              });
}

}  // namespace maneuver::trainer
