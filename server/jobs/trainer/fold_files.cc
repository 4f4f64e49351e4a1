#include "server/jobs/trainer/fold_files.h"

#include <algorithm>
#include <string>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/evaluation/cross_validation_parts.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::trainer {
namespace {

std::filesystem::path FileOf(const std::filesystem::path& folder, int number) {
  return folder / absl::StrCat("checkpoint-", number);
}

}  // namespace

absl::StatusOr<FoldFiles> FoldFiles::Open(std::filesystem::path folder,
                                          v1::CrossValidationPlan plan) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return files::ErrnoStatus(error.value(), "create", folder);
  FoldFiles files(std::move(folder), std::move(plan));
  for (;;) {
    const absl::StatusOr<std::string> bytes =
        files::ReadFile(FileOf(files.folder_, files.files_ + 1));
    if (absl::IsNotFound(bytes.status())) return files;
    if (!bytes.ok()) return bytes.status();
    v1::CrossValidationPart part;
    if (!part.ParseFromString(*bytes) || part.runs_size() != 1) {
      return absl::DataLossError(
          absl::StrCat("checkpoint-", files.files_ + 1, " is damaged; remove it to go on"));
    }
    if (!evaluation::SamePlan(part.plan(), files.plan_) ||
        !std::ranges::equal(part.plan().seeds(), files.plan_.seeds())) {
      return absl::DataLossError(
          absl::StrCat("checkpoint-", files.files_ + 1,
                       " is of other settings, datasets, folds or seeds; name an empty folder"));
    }
    files.runs_.push_back(part.runs(0));
    ++files.files_;
  }
}

absl::Status FoldFiles::Add(const v1::FoldRun& run) {
  v1::CrossValidationPart part;
  *part.mutable_plan() = plan_;
  *part.add_runs() = run;
  return files::WriteFileAtomically(FileOf(folder_, ++files_), part.SerializeAsString());
}

}  // namespace maneuver::trainer
