// Tags datasets by a model, on all cores, into a folder of tags.

#ifndef MANEUVER_MODEL_TAGS_TAG_DATASETS_H_
#define MANEUVER_MODEL_TAGS_TAG_DATASETS_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/inference/action_model.h"
#include "model/tags/tag_folder.h"

namespace maneuver::tags {

struct TaggingProgress {
  int64_t recordings = 0;      // done, of `all_recordings`
  int64_t all_recordings = 0;  // of this part, without those that were tagged before
  int64_t windows = 0;
  int64_t shards = 0;         // tagged now
  int64_t shards_before = 0;  // of this part, tagged by an earlier run
  int64_t bytes = 0;          // of the files of the shards that were tagged now
};

struct TaggingOptions {
  std::vector<std::filesystem::path> datasets;  // folders
  std::filesystem::path output;
  bool merged = true;            // TaggerOptions.merged
  std::optional<double> stride;  // 0.01 to 3600 s; nothing: what the model was trained with
  // Shard k of all shards is tagged if k modulo `parts` is `part`.
  int part = 0;
  int parts = 1;
  int threads = 1;
  // Called after each recording and each shard; returning false ends the work with CANCELLED. May
  // be empty.
  std::function<bool(const TaggingProgress& progress)> progress;
};

struct TaggingSummary {
  int64_t shards = 0;         // tagged now
  int64_t shards_before = 0;  // of this part, tagged by an earlier run
  int64_t recordings = 0;     // tagged now, like the next two
  int64_t windows = 0;
  int64_t rows = 0;
  std::vector<absl::Status> failures;  // of shards that could not be tagged, by shard
};

// Returns how windows are chosen for tags: as in the model's training, but every standing target
// has its windows.
//   stride: seconds; nothing: the training's own
v1::ExampleSettings TaggingExamples(const v1::ModelManifest& manifest,
                                    std::optional<double> stride);

// Tags each shard of this part that is not tagged yet, and passes over shards that are not of
// SHARD_CONTENT_SCENARIOS. A shard's files depend on the shard, the model, the processor's
// precision and the options `merged` and `stride` alone: not on the other datasets, the part or the
// threads. A shard that cannot be read is reported in `failures`, and the next one is tagged. Takes
// memory for a few recordings for each thread, and some 110 bytes for each row of one shard.
//
// Errors: INVALID_ARGUMENT for two datasets of the same name, two shards whose tags would have one
// name, or a stride or part out of range; those of data::ReadDatasetManifest and of
// PrepareTagFolder; those of writing; CANCELLED.
absl::StatusOr<TaggingSummary> TagDatasets(std::shared_ptr<const inference::ActionModel> model,
                                           const TaggingOptions& options);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_DATASETS_H_
