// maneuver-trainer: learns models and measures them, in a process of its own. Started by maneuverd
// for each job, or by hand for offline training. See ../trainer_protocol.h for what the supervisor
// and this process say to each other.

#include <malloc.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <filesystem>
#include <functional>
#include <iostream>
#include <new>
#include <string>
#include <system_error>

#include "absl/status/status.h"
#include "model/kernels/kernel_choice.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "model/machine/openmp_spinning.h"
#include "server/jobs/trainer/cross_validate_command.h"
#include "server/jobs/trainer/evaluate_command.h"
#include "server/jobs/trainer/match_actions_command.h"
#include "server/jobs/trainer/prune_command.h"
#include "server/jobs/trainer/recalibrate_command.h"
#include "server/jobs/trainer/stop_signal.h"
#include "server/jobs/trainer/tag_command.h"
#include "server/jobs/trainer/train_command.h"
#include "server/jobs/trainer/unknown_words.h"
#include "server/jobs/trainer_protocol.h"

namespace {

constexpr char kDescription[] =
    R"(Learns a model of actions from dataset folders, or measures one.

A dataset folder is made by `maneuver synthesize` or `maneuver import waymo`; a
model folder holds weights.safetensors and model.json. To learn from a town:

  maneuver synthesize town --recordings 200
  maneuver-trainer train --dataset town --output model
  maneuver-trainer evaluate --model model --dataset other

Settings are a TrainingSettings message as JSON (proto/maneuver/v1/
training_settings.proto documents every field); what is left out is the
preset's. For example, pedestrians, a horizon of 3 s and a longer joint phase:

  {"preset": "lanes",
   "model": {"target_types": ["AGENT_TYPE_PEDESTRIAN"], "trajectory": {"waypoints": 30}},
   "optimization": {"joint_epochs": 20}, "seed": 7})";

constexpr char kFooter[] = R"(Exit status:
  0   done
  64  settings or flags are wrong
  65  the data cannot be used: damaged
  66  not enough examples for these settings
  70  a defect
  71  not enough memory
  73  the disk is full
  74  the output could not be written
  80  diverged: the loss was no longer finite
  81  collapsed to fewer actions than --least-actions
  83  another rank ended or did not answer; started again, all go on
  84  tags would take more room than they may
  143 stopped by SIGTERM (130: by SIGINT); nothing half-written remains)";

// Starts the program once more if that shortens OpenMP's spinning.
void ShortenSpinning(char** argv) {
  if (!maneuver::machine::ShortenOpenMpSpinning()) return;
  // By its own path, so that ps and top go on showing its name.
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) execv(self.c_str(), argv);
}

// The tensors of a step are freed and asked for again in the next one, megabytes each. By default
// the C library gives such memory back at once, and the kernel has to clear it page by page for
// every step: a tenth of the training.
void KeepFreedMemory() {
  constexpr int kLargest = 32 << 20;  // bytes; what mmap would serve from here on: the most allowed
  mallopt(M_MMAP_THRESHOLD, kLargest);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  mallopt(M_TOP_PAD, 16 << 20);
}

// Returns the exit status of a command that may throw, as where memory is short.
int CatchingExceptions(const std::function<int()>& command) {
  try {
    return command();
  } catch (const std::bad_alloc&) {
    return maneuver::trainer::ExitStatus(maneuver::learning::OutOfMemory());
  } catch (const std::exception& error) {
    return maneuver::trainer::ExitStatus(absl::InternalError(error.what()));
  }
}

// Returns the exit status; another one if what was printed did not get out.
int Finish(int status) {
  if (std::cout.flush() || status != 0) return status;
  std::cerr << "maneuver-trainer: cannot write to standard output\n";
  return static_cast<int>(maneuver::jobs::TrainerExit::kCannotWrite);
}

}  // namespace

int main(int argc, char** argv) {
  ShortenSpinning(argv);
  KeepFreedMemory();
  CLI::App app(kDescription, "maneuver-trainer");
  app.footer(kFooter);
  app.set_version_flag("--version", MANEUVER_VERSION);
  app.require_subcommand(1);
  app.fallthrough();  // --kernels may stand behind the command
  std::string kernel_choice = "auto";
  app.add_option("--kernels", kernel_choice,
                 "Vector code; auto: the processor's best; plain: none, slow")
      ->check(CLI::IsMember({"auto", "plain"}))
      ->envname("MANEUVER_KERNELS")
      ->capture_default_str();
  maneuver::trainer::TrainCommand train(app);
  maneuver::trainer::EvaluateCommand evaluate(app);
  maneuver::trainer::PruneCommand prune(app);
  maneuver::trainer::MatchActionsCommand match(app);
  maneuver::trainer::CrossValidateCommand cross_validate(app);
  maneuver::trainer::RecalibrateCommand recalibrate(app);
  maneuver::trainer::TagCommand tag(app);
  const CLI::App* const devices =
      app.add_subcommand("devices", "Print the devices that a training can use here, one a line");
  app.failure_message([](const CLI::App* failed, const CLI::Error& error) {
    const std::string unknown = maneuver::UnknownWord(*failed);
    return unknown.empty() ? CLI::FailureMessage::simple(failed, error)
                           : unknown + "\nRun with --help for more information.\n";
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? Finish(0)
                                : static_cast<int>(maneuver::jobs::TrainerExit::kInvalidSettings);
  }
  using maneuver::kernels::KernelChoice;
  maneuver::kernels::ChooseKernels(kernel_choice == "plain" ? KernelChoice::kPlain
                                                            : KernelChoice::kAuto);
  if (devices->parsed()) {
    for (const std::string& device : maneuver::learning::UsableDevices()) {
      std::cout << device << "\n";
    }
    return Finish(0);
  }
  maneuver::trainer::InstallStopSignals();
  if (train.chosen() || cross_validate.chosen()) maneuver::learning::FlushDenormals();
  return Finish(CatchingExceptions([&] {
    if (train.chosen()) return train.Run({argv, argv + argc});
    if (match.chosen()) return match.Run();
    if (cross_validate.chosen()) return cross_validate.Run();
    if (recalibrate.chosen()) return recalibrate.Run();
    if (tag.chosen()) return tag.Run();
    return prune.chosen() ? prune.Run() : evaluate.Run();
  }));
}
