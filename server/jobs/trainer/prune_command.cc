#include "server/jobs/trainer/prune_command.h"

#include <algorithm>
#include <iostream>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include "model/artifact/anchor_baselines.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/pruning.h"
#include "model/evaluation/action_names.h"
#include "model/files/durable_file.h"
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
  const auto model = inference::ActionModel::FromStored(*pruned, {inference::Precision::kF32});
  if (!model.ok()) return model.status();
  const std::unique_ptr<bool[]> effective(new bool[kept.size()]);  // std::vector<bool> is no array
  std::fill_n(effective.get(), kept.size(), true);
  const auto actions = inference::DecodeActionSet(**model, usage, {effective.get(), kept.size()});
  for (size_t k = 0; k < actions.size(); ++k) {
    v1::Action& action = *pruned->manifest.add_actions();
    action = actions[k];
    const v1::Action& before = named.actions(kept[k]);
    action.set_label(before.label());
    action.set_derived_name(before.derived_name());
  }
  const absl::Status status = Write(*std::move(pruned));
  if (!status.ok()) return status;
  std::cout << "kept " << kept.size() << " of " << whole->manifest.spec().actions()
            << " actions; maneuver-trainer evaluate measures the model anew\n";
  return absl::OkStatus();
}

absl::Status PruneCommand::Write(artifact::StoredModel pruned) const {
  const absl::StatusOr<std::filesystem::path> temporary = files::MakeTemporaryFolderFor(output_);
  if (!temporary.ok()) return temporary.status();
  const std::filesystem::path draft = *temporary / "model";
  absl::Status status = artifact::WriteModelFolder(draft, std::move(pruned));
  if (status.ok()) status = artifact::CopyBaselines(model_, draft);
  if (status.ok()) status = files::PublishFolder(draft, output_);
  std::error_code ignored;
  std::filesystem::remove_all(*temporary, ignored);
  return status;
}

}  // namespace maneuver::trainer
