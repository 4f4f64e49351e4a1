#ifndef MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_
#define MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_

#include <cstdint>
#include <filesystem>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/data/recording_blocks.h"

namespace maneuver::trainer {

// A dataset to measure on.
struct Recordings {
  data::RecordingBlocks blocks;
  std::vector<v1::ManeuverAnnotation> annotations;
};

// Opens a dataset whose recordings may take `data_memory` bytes of memory. Errors: those of
// data::RecordingBlocks; CANCELLED if a stop signal came.
absl::StatusOr<Recordings> OpenRecordings(const std::filesystem::path& folder, int64_t data_memory);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_RECORDINGS_H_
