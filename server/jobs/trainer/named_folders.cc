#include "server/jobs/trainer/named_folders.h"

#include <set>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::trainer {

namespace fs = std::filesystem;

absl::Status OfFolder(const absl::Status& status, const fs::path& folder) {
  if (status.ok()) return status;
  absl::Status named(status.code(), absl::StrCat(files::NameOf(folder), ": ", status.message()));
  status.ForEachPayload([&named](absl::string_view type, const absl::Cord& payload) {
    named.SetPayload(type, payload);
  });
  return named;
}

absl::Status CheckDatasets(const std::vector<fs::path>& folders) {
  std::set<fs::path> seen;
  for (const fs::path& folder : folders) {
    const auto manifest = data::ReadDatasetManifest(folder);
    if (!manifest.ok()) return OfFolder(manifest.status(), folder);
    std::error_code error;
    const fs::path place = fs::canonical(folder, error);
    if (!error && !seen.insert(place).second) {
      return OfFolder(absl::InvalidArgumentError("the dataset is named twice"), folder);
    }
  }
  return absl::OkStatus();
}

absl::Status PrepareOutput(const fs::path& output) {
  std::error_code error;
  if (output.has_parent_path()) fs::create_directories(output.parent_path(), error);
  absl::Status status;
  if (error) {
    status = files::ErrnoStatus(error.value(), "create the folder of", output);
  } else if (const auto tried = files::MakeTemporaryFolderFor(output); tried.ok()) {
    fs::remove(*tried, error);
  } else {
    status = tried.status();
  }
  if (status.ok() || absl::IsResourceExhausted(status)) return status;
  return absl::PermissionDeniedError(status.message());
}

}  // namespace maneuver::trainer
