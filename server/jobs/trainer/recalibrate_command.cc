#include "server/jobs/trainer/recalibrate_command.h"

#include <iostream>
#include <optional>

#include "absl/strings/str_cat.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/report_text.h"
#include "model/learning/recalibration.h"
#include "server/jobs/trainer/data_memory_option.h"
#include "server/jobs/trainer/dataset_names.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/progress_display.h"
#include "server/jobs/trainer/settings_file.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

RecalibrateCommand::RecalibrateCommand(CLI::App& app)
    : command_(app.add_subcommand(
          "recalibrate",
          "Fit the widths and the temperature of a model again, to recordings that it did not "
          "learn from; its networks stay the same")) {
  command_->add_option("--model", model_, "Model folder")->type_name("FOLDER")->required();
  command_
      ->add_option("--model-name", model_name_,
                   "Its name for the new model's provenance (default: the folder's)")
      ->type_name("NAME");
  command_->add_option("--dataset", datasets_, "Dataset folders to fit to")
      ->type_name("FOLDER")
      ->required();
  command_
      ->add_option("--dataset-name", dataset_names_,
                   "Names of the datasets for the model's provenance (default: the folders')")
      ->type_name("NAME");
  command_
      ->add_option("--settings", settings_,
                   "ExampleSettings as JSON; what is left out is the preset's. The new model is "
                   "measured on the recordings of validation_share")
      ->type_name("FILE");
  command_->add_option("--output", output_, "Model folder to write; it must not exist")
      ->type_name("FOLDER")
      ->required();
  AddDataMemoryOption(*command_, &data_memory_);
  command_->add_option("--threads", threads_, "Threads; 0: one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
  command_
      ->add_option("--progress", progress_,
                   "bar for people, json for programs (a JobProgress a line), or none")
      ->check(CLI::IsMember({"json", "bar", "none"}))
      ->capture_default_str();
}

int RecalibrateCommand::Run() const { return ExitStatus(Recalibrate()); }

absl::Status RecalibrateCommand::Recalibrate() const {
  v1::TrainingSettings settings;
  if (!settings_.empty()) {
    if (absl::Status status = ReadJson(settings_, settings.mutable_examples()); !status.ok()) {
      return status;
    }
  }
  if (std::error_code ignored; std::filesystem::exists(output_, ignored)) {
    return absl::AlreadyExistsError(absl::StrCat(output_.filename().string(), " exists already"));
  }
  if (absl::Status status = CheckDatasets(datasets_); !status.ok()) return status;
  if (absl::Status status = PrepareOutput(output_); !status.ok()) return status;
  learning::RecalibrationRun run;
  run.model = model_;
  run.model_name = model_name_.empty() ? model_.filename().string() : model_name_;
  run.output = output_;
  run.examples = artifact::ResolveTrainingSettings(settings).examples();
  absl::StatusOr<std::vector<std::string>> names = DatasetNames(dataset_names_, datasets_);
  if (!names.ok()) return names.status();
  run.dataset_names = *std::move(names);
  run.trainer_version = MANEUVER_VERSION;
  run.threads = threads_;
  run.data_memory = data_memory_;
  run.stopped = StopRequested;
  const ProgressDisplay::Style style = ProgressDisplay::ParseStyle(progress_);
  std::optional<ProgressDisplay> display(std::in_place, style, std::cout);
  run.progress = [&display](const v1::JobProgress& progress) { display->Show(progress); };
  const absl::StatusOr<v1::ModelManifest> manifest = learning::Recalibrate(run, datasets_);
  display.reset();
  if (!manifest.ok()) return manifest.status();
  if (style != ProgressDisplay::Style::kBar || manifest->metrics().empty()) {
    return absl::OkStatus();
  }
  v1::EvaluationReport report;
  *report.mutable_metrics() = manifest->metrics();
  *report.mutable_rivals() = manifest->rivals();
  std::cout << "On " << manifest->provenance().validation_examples() << " held-out examples:\n\n"
            << evaluation::ReportText(report, PrintsBold());
  return absl::OkStatus();
}

}  // namespace maneuver::trainer
