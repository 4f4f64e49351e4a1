// Registers a folder as a dataset without copying its shards. The store's folder of such a dataset
// contains its manifest, a link to each shard, the indexes, and a file ".registration".

#ifndef MANEUVER_MODEL_DATA_REGISTERED_FOLDER_H_
#define MANEUVER_MODEL_DATA_REGISTERED_FOLDER_H_

#include <filesystem>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"

namespace maneuver::data {

// Returns `folder` without links and "..".
//   roots: the folders that may be registered, each with all that is below it
// INVALID_ARGUMENT if it is not absolute or not a folder; PERMISSION_DENIED if it does not lie in
// one of the roots once links are resolved.
absl::StatusOr<std::filesystem::path> ResolveRegistrable(
    const std::filesystem::path& folder, std::span<const std::filesystem::path> roots);

// Links the shards of `source` into the empty folder `into`, writes their sizes and times to
// .registration, and returns the manifest of `source`. Reads no shard.
//   source: a result of ResolveRegistrable
// INVALID_ARGUMENT, naming the file, if it is not a dataset, or a file is missing, unreadable or
// itself a link.
absl::StatusOr<v1::Dataset> LinkShards(const std::filesystem::path& source,
                                       const std::filesystem::path& into);

// Returns whether a folder was made by LinkShards.
bool IsRegistered(const std::filesystem::path& folder);
// Returns the folder that LinkShards was given; empty if there is none.
std::filesystem::path RegisteredFrom(const std::filesystem::path& folder);

// Checks that the shards of a registered folder are still those that were registered. OK for any
// other folder. If the size or the times of a shard have changed, its SHA-256 is compared with the
// manifest's. If it is equal, the new times are stored. If not, or if a shard is missing, returns
// DATA_LOSS, naming shard and folder; DATA_LOSS too if .registration is damaged.
absl::Status CheckRegistered(const std::filesystem::path& folder, const v1::Dataset& manifest);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_REGISTERED_FOLDER_H_
