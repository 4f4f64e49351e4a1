// Model versions on disk:
//
//   {folder}/{model}/{version}/       one version: model.json, weights.safetensors; made_by, the
//                                     name of the job that made it; evaluations, what was measured
//                                     of it (evaluation_files.h)
//   {folder}/{model}/.last_version    highest number ever given, once that version was deleted: a
//                                     number never comes to mean another version

#ifndef MANEUVER_SERVER_SERVING_VERSION_FOLDERS_H_
#define MANEUVER_SERVER_SERVING_VERSION_FOLDERS_H_

#include <chrono>
#include <filesystem>
#include <map>
#include <set>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/security/resource_name.h"

namespace maneuver::serving {

class VersionFolders {
 public:
  explicit VersionFolders(std::filesystem::path folder) : folder_(std::move(folder)) {}

  // Creates the folder if need be, removes what interrupted writers left, and lists the versions of
  // each model. Entries with other names are left alone.
  absl::StatusOr<std::map<std::string, std::set<int>>> Scan() const;

  std::filesystem::path FolderOf(const security::ModelVersionName& name) const;
  // When it was registered.
  std::chrono::system_clock::time_point CreateTime(const security::ModelVersionName& name) const;

  // The number after the highest that `model` ever had.
  absl::StatusOr<int> NextVersion(const std::string& model, const std::set<int>& versions) const;
  // Moves a finished model folder to its place, stamped with `now` and, unless it is empty,
  // `maker`.
  absl::Status Add(const security::ModelVersionName& name, const std::filesystem::path& finished,
                   const std::string& maker, std::chrono::system_clock::time_point now) const;
  // Who made it; empty if nobody said.
  std::string Maker(const security::ModelVersionName& name) const;
  // Undoes Add.
  absl::Status TakeBack(const security::ModelVersionName& name,
                        const std::filesystem::path& finished) const;
  absl::Status Remove(const security::ModelVersionName& name, bool newest) const;

 private:
  std::filesystem::path LastVersionFile(const std::string& model) const;

  const std::filesystem::path folder_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_FOLDERS_H_
