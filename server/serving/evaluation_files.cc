#include "server/serving/evaluation_files.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/files/sealed_json.h"
#include "server/security/resource_name.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

constexpr char kEvaluations[] = "evaluations";
constexpr char kExtension[] = ".json";

fs::path EvaluationFile(const fs::path& version_folder, const std::string& dataset) {
  return version_folder / kEvaluations / (dataset + kExtension);
}

}  // namespace

absl::Status WriteEvaluation(const fs::path& version_folder, const std::string& dataset,
                             const v1::EvaluationReport& report) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto printed = google::protobuf::util::MessageToJsonString(report, &json, options);
  if (!printed.ok()) {
    return absl::InternalError(
        absl::StrCat("cannot write the report as JSON: ", std::string(printed.message())));
  }
  std::error_code error;
  const bool is_new = fs::create_directory(version_folder / kEvaluations, error);
  if (error) return files::ErrnoStatus(error.value(), "create", version_folder / kEvaluations);
  if (is_new) {
    if (absl::Status status = files::SyncPath(version_folder); !status.ok()) return status;
  }
  return files::WriteFileAtomically(EvaluationFile(version_folder, dataset),
                                    files::Seal(json + "\n"));
}

absl::StatusOr<v1::EvaluationReport> ReadEvaluation(const fs::path& version_folder,
                                                    const std::string& dataset) {
  const absl::StatusOr<std::string> json = files::ReadFile(EvaluationFile(version_folder, dataset));
  if (!json.ok()) return json.status();
  const absl::StatusOr<std::string> unsealed = files::Unseal(*json);
  if (!unsealed.ok()) {
    return absl::DataLossError(absl::StrCat("the report ", unsealed.status().message()));
  }
  v1::EvaluationReport report;
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;  // of a later release
  const auto parsed = google::protobuf::util::JsonStringToMessage(*unsealed, &report, options);
  if (!parsed.ok()) {
    return absl::DataLossError(
        absl::StrCat("the report does not parse: ", std::string(parsed.message())));
  }
  return report;
}

std::vector<std::string> ListEvaluations(const fs::path& version_folder) {
  std::vector<std::string> datasets;
  std::error_code error;
  for (fs::directory_iterator entry(version_folder / kEvaluations, error);
       !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const fs::path& file = entry->path();
    const std::string dataset = file.stem().string();
    if (file.extension() == kExtension && security::IsResourceId(dataset)) {
      datasets.push_back(dataset);
    }
  }
  std::ranges::sort(datasets);
  return datasets;
}

fs::path EvaluationsFolder(const fs::path& version_folder) { return version_folder / kEvaluations; }

}  // namespace maneuver::serving
