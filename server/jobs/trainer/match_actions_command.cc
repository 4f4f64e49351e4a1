#include "server/jobs/trainer/match_actions_command.h"

#include <algorithm>
#include <iostream>

#include "model/artifact/training_presets.h"
#include "model/evaluation/action_coincidence.h"
#include "model/evaluation/action_matching.h"
#include "model/evaluation/action_matching_text.h"
#include "model/evaluation/action_names.h"
#include "model/inference/action_model.h"
#include "model/machine/usable_cores.h"
#include "server/jobs/trainer/data_memory_option.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/recordings.h"
#include "server/jobs/trainer/settings_file.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

MatchActionsCommand::MatchActionsCommand(CLI::App& app)
    : command_(app.add_subcommand(
          "match-actions",
          "Match the effective actions of two models, of two seeds for instance, one to one, and "
          "say how well they agree")) {
  command_->add_option("FIRST", first_, "Model folder")->type_name("FOLDER")->required();
  command_->add_option("SECOND", second_, "Model folder")->type_name("FOLDER")->required();
  command_
      ->add_option("--dataset", dataset_,
                   "Dataset folder on which to measure the shares of the actions and how often "
                   "examples agree")
      ->type_name("FOLDER");
  command_->add_option("--output", output_, "ActionMatching as JSON")->type_name("FILE");
  AddDataMemoryOption(*command_, &data_memory_);
  command_->add_option("--threads", threads_, "Threads; 0: one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
}

int MatchActionsCommand::Run() const { return ExitStatus(Print()); }

absl::Status MatchActionsCommand::Print() const {
  if (!output_.empty()) {
    if (absl::Status status = PrepareOutput(output_); !status.ok()) return status;
  }
  const auto first = inference::ActionModel::Load(first_, {});
  if (!first.ok()) return OfFolder(first.status(), first_);
  const auto second = inference::ActionModel::Load(second_, {});
  if (!second.ok()) return OfFolder(second.status(), second_);
  const absl::StatusOr<v1::ActionMatching> matching = Match(**first, **second);
  if (!matching.ok()) return matching.status();
  std::cout << evaluation::ActionMatchingText(*matching,
                                              evaluation::DisplayNames((*first)->manifest()),
                                              evaluation::DisplayNames((*second)->manifest()));
  return output_.empty() ? absl::OkStatus() : WriteJson(output_, *matching);
}

absl::StatusOr<v1::ActionMatching> MatchActionsCommand::Match(
    const inference::ActionModel& first, const inference::ActionModel& second) const {
  if (dataset_.empty()) return evaluation::MatchActions(first.manifest(), second.manifest());
  const absl::StatusOr<Recordings> recordings = OpenRecordings(dataset_, data_memory_);
  if (!recordings.ok()) return recordings.status();
  evaluation::EvaluationInput input;
  input.blocks = &recordings->blocks;
  input.examples = artifact::ResolveTrainingSettings({}).examples();
  input.threads = threads_ > 0 ? threads_ : machine::UsableCores();
  input.progress = [](int64_t, int64_t) { return !StopRequested(); };
  return evaluation::MeasureMatching(first, second, input);
}

}  // namespace maneuver::trainer
