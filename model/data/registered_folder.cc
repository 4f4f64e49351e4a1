#include "model/data/registered_folder.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <string>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_manifest.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "registration.pb.h"

namespace maneuver::data {
namespace {

namespace fs = std::filesystem;

constexpr char kRegistrationFile[] = ".registration";

bool IsBelow(const fs::path& path, const fs::path& root) {
  return std::mismatch(root.begin(), root.end(), path.begin(), path.end()).first == root.end();
}

int64_t Nanoseconds(const timespec& time) {
  return int64_t{1'000'000'000} * time.tv_sec + time.tv_nsec;
}

// Returns false if there is no regular file. Follows links.
bool ReadState(const fs::path& file, RegisteredShard* shard) {
  struct stat about {};
  if (stat(file.c_str(), &about) != 0 || !S_ISREG(about.st_mode)) return false;
  shard->set_size_bytes(about.st_size);
  shard->set_modify_time(Nanoseconds(about.st_mtim));
  shard->set_change_time(Nanoseconds(about.st_ctim));
  return true;
}

absl::Status CheckRegularFile(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(file, error);
  if (fs::is_regular_file(status)) {
    if (access(file.c_str(), R_OK) == 0) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("the server may not read ", file.string(), "; correct its permissions"));
  }
  return absl::InvalidArgumentError(
      fs::is_symlink(status)
          ? absl::StrCat(file.string(),
                         " is a link; register the folder that holds the files themselves")
          : absl::StrCat(file.string(), " is missing or is not a file"));
}

absl::Status Changed(const std::string& folder, const std::string& shard) {
  return absl::DataLossError(
      absl::StrCat("shard ", shard, " in ", folder,
                   " has changed since it was registered; restore it, or delete the dataset and "
                   "register the folder again"));
}

}  // namespace

absl::StatusOr<fs::path> ResolveRegistrable(const fs::path& folder,
                                            std::span<const fs::path> roots) {
  if (!folder.is_absolute()) return absl::InvalidArgumentError("must be an absolute path");
  std::error_code error;
  const fs::path resolved = fs::canonical(folder, error);
  const bool exists = !error;
  // Whether a folder exists outside the roots is not told.
  const fs::path compared = exists ? resolved : folder.lexically_normal();
  const bool allowed = std::ranges::any_of(roots, [&](const fs::path& root) {
    std::error_code ignored;
    const fs::path resolved_root = fs::canonical(root, ignored);
    return !ignored && IsBelow(compared, exists ? resolved_root : root.lexically_normal());
  });
  if (!allowed) {
    return absl::PermissionDeniedError(
        roots.empty() ? "this server registers no folders: its option --dataset-folders is empty"
                      : absl::StrCat(folder.string(),
                                     " does not lie in a folder that --dataset-folders names"));
  }
  if (!exists || !fs::is_directory(resolved, error)) {
    return absl::InvalidArgumentError(absl::StrCat(folder.string(), " is not a folder"));
  }
  return resolved;
}

absl::StatusOr<v1::Dataset> LinkShards(const fs::path& source, const fs::path& into) {
  if (absl::Status status = CheckRegularFile(source / kManifestFile); !status.ok()) return status;
  const absl::StatusOr<v1::Dataset> manifest = LoadDatasetManifest(source);
  if (!manifest.ok()) return absl::InvalidArgumentError(manifest.status().message());
  Registration registration;
  registration.set_folder(source.string());
  for (const v1::Shard& shard : manifest->shards()) {
    const fs::path file = source / shard.file();
    if (absl::Status status = CheckRegularFile(file); !status.ok()) return status;
    RegisteredShard& registered = *registration.add_shards();
    registered.set_file(shard.file());
    if (!ReadState(file, &registered)) {
      return absl::InvalidArgumentError(absl::StrCat(file.string(), " is missing"));
    }
    std::error_code error;
    fs::create_symlink(file, into / shard.file(), error);
    if (error) return files::ErrnoStatus(error.value(), "link", into / shard.file());
  }
  const absl::Status status =
      files::WriteFileAtomically(into / kRegistrationFile, registration.SerializeAsString());
  if (!status.ok()) return status;
  return manifest;
}

bool IsRegistered(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / kRegistrationFile, error);
}

fs::path RegisteredFrom(const fs::path& folder) {
  const absl::StatusOr<std::string> content = files::ReadFile(folder / kRegistrationFile);
  Registration registration;
  if (!content.ok() || !registration.ParseFromString(*content)) return {};
  return registration.folder();
}

absl::Status CheckRegistered(const fs::path& folder, const v1::Dataset& manifest) {
  if (!IsRegistered(folder)) return absl::OkStatus();
  const absl::StatusOr<std::string> content = files::ReadFile(folder / kRegistrationFile);
  if (!content.ok()) return content.status();
  Registration registration;
  if (!registration.ParseFromString(*content) ||
      registration.shards_size() != manifest.shards_size()) {
    return absl::DataLossError(absl::StrCat(
        kRegistrationFile, " is damaged; delete the dataset and register its folder again"));
  }
  bool noted = false;
  for (int i = 0; i < manifest.shards_size(); ++i) {
    const v1::Shard& shard = manifest.shards(i);
    RegisteredShard& registered = *registration.mutable_shards(i);
    RegisteredShard now = registered;
    if (!ReadState(folder / shard.file(), &now)) {
      return absl::DataLossError(
          absl::StrCat("shard ", shard.file(), " is missing in ", registration.folder()));
    }
    if (now.SerializeAsString() == registered.SerializeAsString()) continue;
    const absl::StatusOr<std::string> sha256 = files::Sha256OfFile(folder / shard.file());
    if (!sha256.ok()) return sha256.status();
    if (*sha256 != shard.sha256()) return Changed(registration.folder(), shard.file());
    registered = now;
    noted = true;
  }
  // If this fails, the shards are read again the next time.
  if (noted) {
    (void)files::WriteFileAtomically(folder / kRegistrationFile, registration.SerializeAsString());
  }
  return absl::OkStatus();
}

}  // namespace maneuver::data
