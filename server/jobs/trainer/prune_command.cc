#include "server/jobs/trainer/prune_command.h"

#include <iostream>
#include <vector>

#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/pruning.h"
#include "model/evaluation/action_names.h"
#include "model/inference/action_model.h"
#include "server/jobs/trainer/stop_signal.h"

namespace maneuver::trainer {

PruneCommand::PruneCommand(CLI::App& app)
    : command_(app.add_subcommand("prune",
                                  "Write a new model without the actions that are not effective")) {
  command_->add_option("--model", model_, "Model folder")->type_name("FOLDER")->required();
  command_->add_option("--output", output_, "Model folder to write; it must not exist")
      ->type_name("FOLDER")
      ->required();
}

int PruneCommand::Run() const { return ExitStatus(Prune()); }

absl::Status PruneCommand::Prune() const {
  const absl::StatusOr<artifact::StoredModel> whole = artifact::ReadModelFolder(model_);
  if (!whole.ok()) return whole.status();
  v1::ModelManifest named = whole->manifest;
  evaluation::CompleteActionNames(named);
  std::vector<int> kept;
  std::vector<double> usage;
  for (const v1::Action& action : named.actions()) {
    if (!action.effective()) continue;
    kept.push_back(action.action_id());
    usage.push_back(action.usage());
  }
  absl::StatusOr<artifact::StoredModel> pruned = artifact::PruneActions(*whole, kept);
  if (!pruned.ok()) return pruned.status();
  absl::Status status = artifact::WriteModelFolder(output_, *std::move(pruned));
  if (!status.ok()) return status;
  const auto model = inference::ActionModel::Load(output_, {inference::Precision::kF32});
  if (!model.ok()) return model.status();
  v1::ModelManifest manifest = (*model)->manifest();
  const std::vector<char> effective(kept.size(), 1);
  const auto actions = inference::DecodeActionSet(
      **model, usage, {reinterpret_cast<const bool*>(effective.data()), effective.size()});
  for (size_t k = 0; k < actions.size(); ++k) {
    v1::Action& action = *manifest.add_actions();
    action = actions[k];
    const v1::Action& before = named.actions(kept[k]);
    action.set_label(before.label());
    action.set_derived_name(before.derived_name());
  }
  status = artifact::RewriteModelManifest(output_, manifest);
  if (status.ok()) status = artifact::CopyBaselines(model_, output_);
  if (!status.ok()) return status;
  std::cout << "kept " << kept.size() << " of " << whole->manifest.spec().actions()
            << " actions; maneuver-trainer evaluate measures the model anew\n";
  return absl::OkStatus();
}

}  // namespace maneuver::trainer
