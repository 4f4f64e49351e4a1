// Tells why a training run failed if its status code alone does not.

#ifndef MANEUVER_MODEL_LEARNING_TRAINING_FAILURE_H_
#define MANEUVER_MODEL_LEARNING_TRAINING_FAILURE_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/cord.h"

namespace maneuver::learning {

enum class TrainingFailure : char {
  kNotEnoughExamples = 'e',
  kOutOfMemory = 'm',
  kCollapsed = 'c',  // to fewer actions than required
  kRankLost = 'r',   // another rank ended or did not answer in time
};

inline constexpr char kTrainingFailureUrl[] = "maneuver/training-failure";

inline absl::Status WithFailure(absl::Status status, TrainingFailure failure) {
  status.SetPayload(kTrainingFailureUrl, absl::Cord(std::string(1, static_cast<char>(failure))));
  return status;
}

inline std::optional<TrainingFailure> FailureOf(const absl::Status& status) {
  const auto payload = status.GetPayload(kTrainingFailureUrl);
  if (!payload || payload->empty()) return std::nullopt;
  return static_cast<TrainingFailure>((*payload)[0]);
}

inline absl::Status OutOfMemory() {
  return WithFailure(absl::ResourceExhaustedError(
                         "out of memory; use fewer recordings, smaller networks or batches, or "
                         "raise the limit of the job"),
                     TrainingFailure::kOutOfMemory);
}

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TRAINING_FAILURE_H_
