// Model versions of which only the names matter: nothing reads their folders.

#ifndef MANEUVER_TESTS_UNIT_SERVER_JOBS_FAKE_MODEL_VERSIONS_H_
#define MANEUVER_TESTS_UNIT_SERVER_JOBS_FAKE_MODEL_VERSIONS_H_

#include <algorithm>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "server/errors/error_details.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// Numbers published versions from 1, across models. Version 7 of models/town exists, in
// {folder}/model/7: every alias resolves to it, and so does a missing reference. models/none has no
// versions.
class FakeModelVersions final : public serving::ModelVersions {
 public:
  explicit FakeModelVersions(std::filesystem::path folder) : folder_(std::move(folder)) {}

  absl::StatusOr<ResolvedVersion> Resolve(
      const std::optional<security::ModelReference>& reference) const override {
    const std::lock_guard lock(mutex);
    if (!resolve_error.ok()) return resolve_error;
    security::ModelVersionName name{"town", 7};
    if (reference) {
      const auto* version = std::get_if<security::ModelVersionName>(&*reference);
      const auto* alias = std::get_if<security::ModelAliasName>(&*reference);
      if ((alias != nullptr ? alias->model : version->model) == "none") {
        return absl::NotFoundError("there is no such model");
      }
      if (version != nullptr) name = *version;
    }
    return ResolvedVersion{name, folder_ / "model" / std::to_string(name.version)};
  }
  std::vector<ListedVersion> List() const override {
    const std::lock_guard lock(mutex);
    return listed;
  }
  std::optional<security::ModelVersionName> Serving(const std::string&) const override {
    const std::lock_guard lock(mutex);
    return serving;
  }
  absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                     const std::filesystem::path& finished,
                                                     v1::Promotion promotion,
                                                     const serving::Maker& maker) override {
    const std::lock_guard lock(mutex);
    if (!publish_error.ok()) return publish_error;
    promotions.push_back(promotion);
    const security::ModelVersionName name{model, static_cast<int>(promotions.size())};
    std::filesystem::rename(finished, folder_ / (model + std::to_string(name.version)));
    published[maker.name] = name;
    return name;
  }
  absl::StatusOr<std::optional<security::ModelVersionName>> FindMadeBy(
      const std::string&, v1::Promotion, const serving::Maker& maker) override {
    const std::lock_guard lock(mutex);
    const auto found = published.find(maker.name);
    if (found == published.end()) return std::nullopt;
    return found->second;
  }
  absl::StatusOr<bool> PromoteOver(const security::ModelVersionName& name,
                                   const std::optional<security::ModelVersionName>& before,
                                   const serving::Maker&) override {
    const std::lock_guard lock(mutex);
    if (serving != before) return false;
    serving = name;
    return true;
  }
  absl::Status KeepReport(const v1::EvaluationReport& report, const serving::Maker&) override {
    const std::lock_guard lock(mutex);
    if (store_away > 0) {
      --store_away;
      return errors::WithReason(absl::UnavailableError("no database"), "STORE_UNAVAILABLE");
    }
    if (keep_error.ok()) reports[report.model_version()] = report;
    return keep_error;
  }
  absl::StatusOr<v1::EvaluationReport> GetReport(
      const security::EvaluationName& name) const override {
    const std::lock_guard lock(mutex);
    const auto found = reports.find(name.version.ToString());
    if (found == reports.end()) return absl::NotFoundError("it was not evaluated");
    return found->second;
  }
  absl::Status Delete(const security::ModelVersionName& name) override {
    const std::lock_guard lock(mutex);
    deleted.push_back(name.ToString());
    std::erase_if(listed, [&](const ListedVersion& each) { return each.name == name; });
    return absl::OkStatus();
  }

  // What tests set and read. While jobs run: with the mutex held.
  mutable std::mutex mutex;
  absl::Status resolve_error;
  absl::Status publish_error;
  absl::Status keep_error;
  int store_away = 0;                     // next calls of KeepReport that find no store
  std::vector<v1::Promotion> promotions;  // of Publish
  std::map<std::string, security::ModelVersionName> published;  // by maker
  std::map<std::string, v1::EvaluationReport> reports;          // by version
  std::optional<security::ModelVersionName> serving;
  std::vector<ListedVersion> listed;
  std::vector<std::string> deleted;

 private:
  const std::filesystem::path folder_;
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_TESTS_UNIT_SERVER_JOBS_FAKE_MODEL_VERSIONS_H_
