#include "model/data/dataset_files.h"

#include <cstdint>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_manifest.h"
#include "model/data/registered_folder.h"

namespace maneuver::data {

absl::StatusOr<v1::Dataset> ReadDatasetManifest(const std::filesystem::path& folder) {
  auto manifest = LoadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  for (const v1::Shard& shard : manifest->shards()) {
    std::error_code error;
    const uintmax_t size = std::filesystem::file_size(folder / shard.file(), error);
    if (error) return absl::DataLossError(absl::StrCat("shard ", shard.file(), " is missing"));
    if (size != static_cast<uintmax_t>(shard.size_bytes())) {
      return absl::DataLossError(absl::StrCat("shard ", shard.file(), " has ", size, " bytes; ",
                                              kManifestFile, " says ", shard.size_bytes()));
    }
  }
  if (absl::Status status = CheckRegistered(folder, *manifest); !status.ok()) return status;
  return manifest;
}

}  // namespace maneuver::data
