// Gives jobs the versions that this server stores and serves.

#ifndef MANEUVER_SERVER_SERVING_LOCAL_MODEL_VERSIONS_H_
#define MANEUVER_SERVER_SERVING_LOCAL_MODEL_VERSIONS_H_

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/serving/model_versions.h"
#include "server/serving/serving_table.h"
#include "server/serving/version_store.h"

namespace maneuver::serving {

class LocalModelVersions final : public ModelVersions {
 public:
  // `store` and `table` must outlive this object. `table` must be the table of `store`.
  LocalModelVersions(VersionStore& store, ServingTable& table) : store_(store), table_(table) {}

  absl::StatusOr<ResolvedVersion> Resolve(
      const std::optional<security::ModelReference>& reference) const override;
  std::vector<ListedVersion> List() const override;
  std::optional<security::ModelVersionName> Serving(const std::string& model) const override;
  absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                     const std::filesystem::path& finished,
                                                     v1::Promotion promotion,
                                                     const Maker& maker) override;
  absl::StatusOr<std::optional<security::ModelVersionName>> FindMadeBy(const std::string& model,
                                                                       v1::Promotion promotion,
                                                                       const Maker& maker) override;
  absl::StatusOr<bool> PromoteOver(const security::ModelVersionName& name,
                                   const std::optional<security::ModelVersionName>& before,
                                   const Maker& maker) override;
  absl::Status KeepReport(const v1::EvaluationReport& report, const Maker& maker) override;
  absl::StatusOr<v1::EvaluationReport> GetReport(
      const security::EvaluationName& name) const override;
  absl::Status Delete(const security::ModelVersionName& name) override;

 private:
  VersionStore& store_;
  ServingTable& table_;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_LOCAL_MODEL_VERSIONS_H_
