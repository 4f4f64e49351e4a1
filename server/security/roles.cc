#include "server/security/roles.h"

#include <algorithm>
#include <array>

#include "absl/strings/str_cat.h"

namespace maneuver::security {
namespace {

constexpr std::array kRoles = {Role::kPredict, Role::kTrain, Role::kAdmin};

// Health and reflection are deliberately open: probes and tools have no credentials. They reveal
// only whether the server is ready and the contract, which is public, and no model, dataset or job.
constexpr MethodRole kMethodRoles[] = {
    {"/grpc.health.v1.Health/Check", Role::kAnyone},
    {"/grpc.health.v1.Health/Watch", Role::kAnyone},
    {"/grpc.reflection.v1.ServerReflection/ServerReflectionInfo", Role::kAnyone},
    {"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", Role::kAnyone},

    {"/maneuver.v1.PredictionService/PredictActionProbabilities", Role::kPredict},
    {"/maneuver.v1.PredictionService/PredictActionDistributions", Role::kPredict},
    {"/maneuver.v1.PredictionService/Predict", Role::kPredict},
    {"/maneuver.v1.PredictionService/ClassifyTrajectories", Role::kPredict},
    {"/maneuver.v1.PredictionService/StreamPredict", Role::kPredict},
    {"/maneuver.v1.PredictionService/RegisterMap", Role::kPredict},

    {"/maneuver.v1.OutcomeService/ReportOutcomes", Role::kPredict},
    {"/maneuver.v1.OutcomeService/StreamOutcomes", Role::kPredict},
    {"/maneuver.v1.OutcomeService/CollectOutcomes", Role::kTrain},

    {"/maneuver.v1.ModelService/ListModelVersions", Role::kPredict},
    {"/maneuver.v1.ModelService/GetModelVersion", Role::kPredict},
    {"/maneuver.v1.ModelService/GetActionSet", Role::kPredict},
    {"/maneuver.v1.ModelService/ListEvaluationReports", Role::kPredict},
    {"/maneuver.v1.ModelService/GetEvaluationReport", Role::kPredict},
    {"/maneuver.v1.ModelService/LabelAction", Role::kTrain},
    {"/maneuver.v1.ModelService/DownloadModelVersion", Role::kTrain},
    {"/maneuver.v1.ModelService/UploadModelVersion", Role::kAdmin},
    {"/maneuver.v1.ModelService/QueryModelUpload", Role::kAdmin},
    {"/maneuver.v1.ModelService/SetModelAlias", Role::kAdmin},
    {"/maneuver.v1.ModelService/DeleteModelAlias", Role::kAdmin},
    {"/maneuver.v1.ModelService/DeleteModelVersion", Role::kAdmin},

    {"/maneuver.v1.DatasetService/UploadDataset", Role::kTrain},
    {"/maneuver.v1.DatasetService/QueryUpload", Role::kTrain},
    {"/maneuver.v1.DatasetService/RegisterDataset", Role::kAdmin},
    {"/maneuver.v1.DatasetService/ListDatasets", Role::kTrain},
    {"/maneuver.v1.DatasetService/GetDataset", Role::kTrain},
    {"/maneuver.v1.DatasetService/DescribeDataset", Role::kTrain},
    {"/maneuver.v1.DatasetService/ListScenarios", Role::kTrain},
    {"/maneuver.v1.DatasetService/GetScenario", Role::kTrain},
    {"/maneuver.v1.DatasetService/DeleteDataset", Role::kAdmin},

    {"/maneuver.v1.TrainingService/Train", Role::kTrain},
    {"/maneuver.v1.TrainingService/Evaluate", Role::kTrain},
    {"/maneuver.v1.TrainingService/CrossValidate", Role::kTrain},
    {"/maneuver.v1.TrainingService/Recalibrate", Role::kTrain},
    {"/maneuver.v1.TrainingService/Tag", Role::kTrain},
    {"/maneuver.v1.TrainingService/GetJob", Role::kTrain},
    {"/maneuver.v1.TrainingService/ListJobs", Role::kTrain},
    {"/maneuver.v1.TrainingService/WatchJob", Role::kTrain},
    {"/maneuver.v1.TrainingService/CancelJob", Role::kTrain},
    {"/maneuver.v1.TrainingService/ResumeJob", Role::kTrain},
    {"/maneuver.v1.TrainingService/DeleteJob", Role::kAdmin},

    {"/maneuver.v1.ReplicaService/ListReplicas", Role::kPredict},
    {"/maneuver.v1.TagService/ListTags", Role::kTrain},
    {"/maneuver.v1.TagService/GetTags", Role::kTrain},
    {"/maneuver.v1.TagService/DownloadTags", Role::kTrain},
    {"/maneuver.v1.TagService/DeleteTags", Role::kAdmin},

    {"/maneuver.v1.AdminService/GetLogLevel", Role::kAdmin},
    {"/maneuver.v1.AdminService/SetLogLevel", Role::kAdmin},
};

}  // namespace

std::string_view ToString(Role role) {
  switch (role) {
    case Role::kAnyone:
      return "anyone";
    case Role::kPredict:
      return "predict";
    case Role::kTrain:
      return "train";
    case Role::kAdmin:
      return "admin";
  }
  return "unknown";
}

absl::StatusOr<RoleSet> RoleSet::Parse(std::string_view text) {
  RoleSet roles;
  for (;;) {
    const size_t comma = text.find(',');
    const std::string_view name = text.substr(0, comma);
    const auto* const role =
        std::ranges::find(kRoles, name, [](Role r) { return maneuver::security::ToString(r); });
    if (role == kRoles.end()) {
      return absl::InvalidArgumentError(
          "roles are predict, train and admin, separated by commas without spaces");
    }
    roles.Add(*role);
    if (comma == std::string_view::npos) return roles;
    text.remove_prefix(comma + 1);
  }
}

std::string RoleSet::ToString() const {
  std::string text;
  for (const Role role : kRoles) {
    if (!Contains(role)) continue;
    absl::StrAppend(&text, text.empty() ? "" : ",",
                    std::string(maneuver::security::ToString(role)));
  }
  return text;
}

std::span<const MethodRole> MethodRoles() { return kMethodRoles; }

std::optional<Role> RequiredRole(std::string_view method) {
  const auto* const row = std::ranges::find(kMethodRoles, method, &MethodRole::method);
  if (row == std::end(kMethodRoles)) return std::nullopt;
  return row->role;
}

}  // namespace maneuver::security
