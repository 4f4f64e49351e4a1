#include "server/jobs/trainer/dataset_names.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"

namespace maneuver::trainer {

absl::StatusOr<std::vector<std::string>> DatasetNames(
    const std::vector<std::string>& given, const std::vector<std::filesystem::path>& folders) {
  std::vector<std::string> names = given;
  if (names.empty()) {
    for (const std::filesystem::path& folder : folders) names.push_back(files::NameOf(folder));
  }
  if (names.size() == folders.size()) return names;
  return absl::InvalidArgumentError(absl::StrCat("--dataset-name: ", names.size(), " names for ",
                                                 folders.size(), " folders of --dataset"));
}

}  // namespace maneuver::trainer
