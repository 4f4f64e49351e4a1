#include "server/jobs/trainer/stop_signal.h"

#include <csignal>
#include <iostream>
#include <string>

#include "model/learning/training_failure.h"
#include "server/jobs/trainer_protocol.h"

namespace maneuver::trainer {
namespace {

volatile std::sig_atomic_t stop_signal = 0;

extern "C" void RememberSignal(int signal) { stop_signal = signal; }

using jobs::TrainerExit;

TrainerExit ExitFor(const absl::Status& status) {
  if (const auto failure = learning::FailureOf(status)) {
    switch (*failure) {
      case learning::TrainingFailure::kNotEnoughExamples:
        return TrainerExit::kNotEnough;
      case learning::TrainingFailure::kOutOfMemory:
        return TrainerExit::kOutOfMemory;
      case learning::TrainingFailure::kCollapsed:
        return TrainerExit::kCollapsed;
      case learning::TrainingFailure::kRankLost:
        return TrainerExit::kRankLost;
    }
  }
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return TrainerExit::kOk;
    case absl::StatusCode::kInvalidArgument:
      return TrainerExit::kInvalidSettings;
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kNotFound:
      return TrainerExit::kUnusableData;
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnavailable:
      return TrainerExit::kCannotWrite;
    case absl::StatusCode::kResourceExhausted:
      return TrainerExit::kDiskFull;
    case absl::StatusCode::kAborted:
      return TrainerExit::kDiverged;
    case absl::StatusCode::kOutOfRange:
      return TrainerExit::kNotFinite;
    default:
      return TrainerExit::kInternal;
  }
}

}  // namespace

void InstallStopSignals() {
  struct sigaction action = {};
  action.sa_handler = RememberSignal;
  // The second of its kind has its usual effect.
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  signal(SIGCHLD, SIG_DFL);  // if it is ignored, nobody learns how ranks end
}

bool StopRequested() { return stop_signal != 0; }

int ExitStatus(const absl::Status& status) {
  if (!status.ok()) std::cerr << "maneuver-trainer: " << std::string(status.message()) << "\n";
  if (absl::IsCancelled(status) && stop_signal != 0) return 128 + stop_signal;
  return static_cast<int>(ExitFor(status));
}

}  // namespace maneuver::trainer
