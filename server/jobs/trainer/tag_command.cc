#include "server/jobs/trainer/tag_command.h"

#include <algorithm>
#include <chrono>
#include <iostream>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/inference/action_model.h"
#include "model/learning/training_progress.h"
#include "model/machine/usable_cores.h"
#include "server/jobs/trainer/named_folders.h"
#include "server/jobs/trainer/progress_display.h"
#include "server/jobs/trainer/stop_signal.h"
#include "server/jobs/trainer_protocol.h"

namespace maneuver::trainer {
namespace {

constexpr int kSteps = 100;  // of the progress

}  // namespace

TagCommand::TagCommand(CLI::App& app)
    : command_(app.add_subcommand(
          "tag", "Tag each target of datasets with its actions, as maneuver tag does")) {
  command_->add_option("--model", model_, "Model folder")->type_name("FOLDER")->required();
  command_->add_option("--dataset", datasets_, "Dataset folders")->type_name("FOLDER")->required();
  command_->add_option("--output", output_, "Folder for the tags; complete shards in it are kept")
      ->type_name("FOLDER")
      ->required();
  command_->add_option("--part", part_, "Tag every shard whose number modulo --parts is this one")
      ->check(CLI::NonNegativeNumber)
      ->type_name("I");
  command_->add_option("--parts", parts_, "Number of parts")
      ->check(CLI::PositiveNumber)
      ->capture_default_str()
      ->type_name("N");
  command_->add_flag("--windows", windows_,
                     "Write a row for each window, even if consecutive windows have one action");
  command_->add_option("--stride", stride_, "Seconds between two windows of a target")
      ->type_name("S");
  command_
      ->add_option("--room", room_, "Most bytes to write, checked after each shard; then exit 84")
      ->check(CLI::NonNegativeNumber)
      ->type_name("BYTES");
  command_
      ->add_option("--checkpoints", checkpoints_,
                   "Keep a file checkpoint-NUMBER in this folder, with the number of complete "
                   "shards")
      ->type_name("FOLDER");
  command_->add_option("--threads", threads_, "Threads; 0: one for each core")
      ->check(CLI::Range(0, 1024))
      ->type_name("N");
  command_
      ->add_option("--progress", progress_,
                   "bar for people, json for programs (a JobProgress a line), or none")
      ->check(CLI::IsMember({"json", "bar", "none"}))
      ->capture_default_str();
}

int TagCommand::Run() const {
  bool no_room = false;
  const int status = ExitStatus(Tag(&no_room));
  return no_room ? static_cast<int>(jobs::TrainerExit::kNoRoom) : status;
}

absl::Status TagCommand::KeepCheckpoint(int64_t shards) const {
  if (checkpoints_.empty()) return absl::OkStatus();
  std::error_code error;
  std::filesystem::create_directories(checkpoints_, error);
  if (error) return files::ErrnoStatus(error.value(), "create", checkpoints_);
  const auto file = [&](int64_t number) {
    return checkpoints_ / absl::StrCat("checkpoint-", number);
  };
  absl::Status status = files::WriteFileAtomically(file(shards), "");
  if (status.ok()) std::filesystem::remove(file(shards - 1), error);
  return status;
}

absl::Status TagCommand::Tag(bool* no_room) const {
  ProgressDisplay display(ProgressDisplay::ParseStyle(progress_), std::cout);
  learning::TrainingProgress progress(
      {{"load", 1, 1, 1.0}, {"tag", 1, kSteps, 1.0}},
      [&display](const v1::JobProgress& each) { display.Show(each); },
      [] { return std::chrono::system_clock::now(); });
  progress.BeginPhase("load");
  auto model = inference::ActionModel::Load(model_, {.precision = inference::Precision::kF32});
  if (!model.ok()) return OfFolder(model.status(), model_);
  progress.BeginPhase("tag");
  tags::TaggingOptions options;
  options.datasets = datasets_;
  options.output = output_;
  options.merged = !windows_;
  options.stride = stride_;
  options.part = part_;
  options.parts = parts_;
  options.threads = threads_ > 0 ? threads_ : machine::UsableCores();
  absl::Status kept;  // what ended the tagging, if this did
  int64_t reported = 0;
  tags::TaggingProgress last;
  options.progress = [&](const tags::TaggingProgress& now) {
    for (const int64_t steps = kSteps * now.recordings / std::max<int64_t>(1, now.all_recordings);
         reported < steps; ++reported) {
      progress.Step(now.windows - last.windows);
      last.windows = now.windows;
    }
    if (now.shards > last.shards) {
      last.shards = now.shards;
      kept = KeepCheckpoint(now.shards_before + now.shards);
      *no_room = room_ && now.bytes > *room_;
      if (kept.ok() && *no_room) {
        kept = absl::ResourceExhaustedError(absl::StrCat(
            "the shards so far have ", now.bytes, " bytes, more than the ", *room_, " of --room"));
      }
    }
    return kept.ok() && !StopRequested();
  };
  const auto summary = tags::TagDatasets(*std::move(model), options);
  if (!kept.ok()) return kept;
  // A folder with other tags: the request does not fit.
  if (absl::IsAlreadyExists(summary.status())) {
    return absl::InvalidArgumentError(summary.status().message());
  }
  if (!summary.ok()) return summary.status();
  for (const absl::Status& failure : summary->failures) {
    std::cerr << "maneuver-trainer: " << std::string(failure.message()) << "\n";
  }
  if (!summary->failures.empty()) {
    return absl::DataLossError(absl::StrCat(
        summary->failures.size(), " of ",
        summary->shards + summary->shards_before + static_cast<int64_t>(summary->failures.size()),
        " shards cannot be read; first: ", summary->failures.front().message()));
  }
  return absl::OkStatus();
}

}  // namespace maneuver::trainer
