#include "server/serving/version_folders.h"

#include <algorithm>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "server/serving/evaluation_files.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

constexpr char kMaker[] = "made_by";
constexpr char kLastVersion[] = ".last_version";
// Written once when a model is exported and never again, unlike model.json: its time of change is
// free to say when the version was registered.
constexpr char kWeights[] = "weights.safetensors";

absl::Status FileError(std::string_view what, const std::error_code& error) {
  return absl::InternalError(absl::StrCat("cannot ", std::string(what), ": ", error.message()));
}

}  // namespace

absl::StatusOr<std::map<std::string, std::set<int>>> VersionFolders::Scan() const {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return FileError("create the folder of models", error);
  if (auto status = files::RemoveTemporaries(folder_); !status.ok()) return status;

  std::map<std::string, std::set<int>> found;
  for (const auto& model : fs::directory_iterator(folder_, error)) {
    const std::string id = model.path().filename();
    if (!security::IsResourceId(id) || !model.is_directory(error)) continue;
    if (auto status = files::RemoveTemporaries(model.path()); !status.ok()) return status;
    for (const auto& version : fs::directory_iterator(model.path(), error)) {
      const int number = security::ParseVersion(version.path().filename().string());
      if (number == 0 || !version.is_directory(error)) continue;
      found[id].insert(number);
      // What a label that was being written left, and a report.
      if (auto status = files::RemoveTemporaries(version.path()); !status.ok()) return status;
      if (auto status = RemoveUnfinishedEvaluations(version.path()); !status.ok()) return status;
    }
  }
  if (error) return FileError("list the folder of models", error);
  return found;
}

fs::path VersionFolders::FolderOf(const security::ModelVersionName& name) const {
  return folder_ / name.model / std::to_string(name.version);
}

fs::path VersionFolders::LastVersionFile(const std::string& model) const {
  return folder_ / model / kLastVersion;
}

std::chrono::system_clock::time_point VersionFolders::CreateTime(
    const security::ModelVersionName& name) const {
  std::error_code error;
  const auto time = fs::last_write_time(FolderOf(name) / kWeights, error);
  return error ? std::chrono::system_clock::time_point() : std::chrono::file_clock::to_sys(time);
}

absl::StatusOr<int> VersionFolders::NextVersion(const std::string& model,
                                                const std::set<int>& versions) const {
  int last = versions.empty() ? 0 : *versions.rbegin();
  const auto recorded = files::ReadFile(LastVersionFile(model));
  if (recorded.ok()) {
    last = std::max(last, security::ParseVersion(*recorded));
  } else if (!absl::IsNotFound(recorded.status())) {
    return recorded.status();
  }
  return last + 1;
}

std::string VersionFolders::Maker(const security::ModelVersionName& name) const {
  return files::ReadFile(FolderOf(name) / kMaker).value_or("");
}

absl::Status VersionFolders::Add(const security::ModelVersionName& name, const fs::path& finished,
                                 const std::string& maker,
                                 std::chrono::system_clock::time_point now) const {
  std::error_code error;
  if (!maker.empty()) {
    if (auto status = files::WriteFileAtomically(finished / kMaker, maker); !status.ok()) {
      return status;
    }
  }
  fs::create_directories(folder_ / name.model, error);
  if (error) return FileError("create the folder of a model", error);
  fs::last_write_time(finished / kWeights, std::chrono::file_clock::from_sys(now), error);
  if (error) return FileError("stamp a model", error);
  if (auto status = files::PublishFolder(finished, FolderOf(name)); !status.ok()) return status;
  return files::SyncPath(folder_);
}

absl::Status VersionFolders::TakeBack(const security::ModelVersionName& name,
                                      const fs::path& finished) const {
  std::error_code error;
  fs::rename(FolderOf(name), finished, error);
  return error ? FileError("take back a model version", error) : absl::OkStatus();
}

absl::Status VersionFolders::Remove(const security::ModelVersionName& name, bool newest) const {
  if (newest) {
    const auto status =
        files::WriteFileAtomically(LastVersionFile(name.model), std::to_string(name.version));
    if (!status.ok()) return status;
  }
  // Out of sight in one step, then file by file: a crash in between leaves a temporary.
  const auto temporary = files::MakeTemporaryFolderFor(FolderOf(name));
  if (!temporary.ok()) return temporary.status();
  std::error_code error;
  fs::rename(FolderOf(name), *temporary, error);
  if (error) return FileError("remove a model version", error);
  if (auto status = files::SyncPath(folder_ / name.model); !status.ok()) return status;
  fs::remove_all(*temporary, error);
  return absl::OkStatus();
}

}  // namespace maneuver::serving
