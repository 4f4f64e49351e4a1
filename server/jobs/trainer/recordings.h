#ifndef MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_

#include <filesystem>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::trainer {

// All of a dataset, in memory.
struct Recordings {
  std::vector<v1::Scenario> scenarios;
  std::vector<v1::ManeuverAnnotation> annotations;
};

// Reads a dataset folder. Errors: those of data::ForEachScenario; CANCELLED if a stop signal came.
absl::StatusOr<Recordings> ReadRecordings(const std::filesystem::path& folder);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_
