#include "server/serving/local_model_versions.h"

#include <utility>

namespace maneuver::serving {

using security::ModelVersionName;

absl::StatusOr<ModelVersions::ResolvedVersion> LocalModelVersions::Resolve(
    const std::optional<security::ModelReference>& reference) const {
  absl::StatusOr<ModelVersionName> name = table_.Resolve(reference);
  if (!name.ok()) return name.status();
  std::filesystem::path folder = store_.FolderOf(*name);
  return ResolvedVersion{*std::move(name), std::move(folder)};
}

std::vector<ModelVersions::ListedVersion> LocalModelVersions::List() const {
  std::vector<ListedVersion> listed;
  for (VersionStore::StoredVersion& version : store_.List("")) {
    const bool has_alias = !table_.AliasesOf(version.name).empty();
    std::string maker = store_.MakerOf(version.name);
    listed.push_back({std::move(version.name), has_alias, std::move(maker)});
  }
  return listed;
}

std::optional<ModelVersionName> LocalModelVersions::Serving(const std::string& model) const {
  return table_.Serving(model);
}

absl::StatusOr<ModelVersionName> LocalModelVersions::Publish(const std::string& model,
                                                             const std::filesystem::path& finished,
                                                             v1::Promotion promotion,
                                                             const Maker& maker) {
  return table_.Publish(model, finished, promotion, maker);
}

absl::StatusOr<std::optional<ModelVersionName>> LocalModelVersions::FindMadeBy(
    const std::string& model, v1::Promotion promotion, const Maker& maker) {
  return table_.FindMadeBy(model, promotion, maker);
}

absl::StatusOr<bool> LocalModelVersions::PromoteOver(const ModelVersionName& name,
                                                     const std::optional<ModelVersionName>& before,
                                                     const Maker& maker) {
  return table_.PromoteOver(name, before, maker);
}

absl::Status LocalModelVersions::KeepReport(const v1::EvaluationReport& report,
                                            const Maker& maker) {
  return store_.KeepReport(report, maker);
}

absl::StatusOr<v1::EvaluationReport> LocalModelVersions::GetReport(
    const security::EvaluationName& name) const {
  return store_.GetReport(name);
}

absl::Status LocalModelVersions::Delete(const ModelVersionName& name) {
  return table_.Delete(name);
}

}  // namespace maneuver::serving
