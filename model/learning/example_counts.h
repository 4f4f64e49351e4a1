// How many training examples each recording of a folder has. No LibTorch in this header.

#ifndef MANEUVER_MODEL_LEARNING_EXAMPLE_COUNTS_H_
#define MANEUVER_MODEL_LEARNING_EXAMPLE_COUNTS_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/recording_index.h"

namespace maneuver::learning {

// Stands in place of the count of a recording that is held out for validation.
inline constexpr int32_t kHeldOut = -1;

// Returns the count of each recording of an index. The first call for a content, a model spec and
// example settings reads every training recording, on `threads` threads, and keeps the counts in
// the folder, in ".examples-<digest>", if it can be written to. Later calls read that file alone.
//   folder: the folder that `index` describes;  settings: complete
//   keep_going: asked between recordings, from several threads; false ends it with CANCELLED
// Errors: those of data::ReadDatasetManifest and of RecordingIndex::Read.
absl::StatusOr<std::vector<int32_t>> CountExamplesPerRecording(
    const std::filesystem::path& folder, const data::RecordingIndex& index,
    const v1::TrainingSettings& settings, int threads, const std::function<bool()>& keep_going);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EXAMPLE_COUNTS_H_
