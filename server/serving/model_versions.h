// The interface by which jobs read and change the versions of models.

#ifndef MANEUVER_SERVER_SERVING_MODEL_VERSIONS_H_
#define MANEUVER_SERVER_SERVING_MODEL_VERSIONS_H_

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/evaluation.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/security/resource_name.h"
#include "server/serving/maker.h"

namespace maneuver::serving {

// Safe to use from any thread. Functions may wait for the disk; those marked "may take long" load
// weights. Those with a maker change nothing and return ABORTED if its lease has ended.
class ModelVersions {
 public:
  struct ResolvedVersion {
    security::ModelVersionName name;
    std::filesystem::path folder;
  };
  struct ListedVersion {
    security::ModelVersionName name;
    bool has_alias = false;
    std::string maker = {};  // Maker.name of who made it
  };

  virtual ~ModelVersions() = default;

  // Returns the version that a request refers to; without a reference, the version of the only
  // model that serves. Errors: NOT_FOUND; FAILED_PRECONDITION if there is no reference and not
  // exactly one model serves.
  virtual absl::StatusOr<ResolvedVersion> Resolve(
      const std::optional<security::ModelReference>& reference) const = 0;
  // Lists all versions of all models, newest first.
  virtual std::vector<ListedVersion> List() const = 0;
  // Returns the version that serves a model, if one does.
  virtual std::optional<security::ModelVersionName> Serving(const std::string& model) const = 0;

  // Publishes the finished model folder `finished` as the next version of `model`, stamped with the
  // name of the job that made it. The folder is moved. An error changes nothing, except that the
  // version stays if its alias could not be set because the store is away or the lease has ended:
  // FindMadeBy then promotes it. May take long.
  //   promotion: decides whether the version serves at once; with PROMOTION_IF_NO_WORSE it does
  //     not.
  virtual absl::StatusOr<security::ModelVersionName> Publish(const std::string& model,
                                                             const std::filesystem::path& finished,
                                                             v1::Promotion promotion,
                                                             const Maker& maker) = 0;
  // Returns the version of `model` that the job `maker` published, if there is one. Promotes it as
  // Publish would have, in case the server died between the two. May take long.
  virtual absl::StatusOr<std::optional<security::ModelVersionName>> FindMadeBy(
      const std::string& model, v1::Promotion promotion, const Maker& maker) = 0;
  // Makes a version serve, but only if `before` is the version that serves the model now (nothing:
  // if none serves). Otherwise changes nothing and returns false. May take long.
  virtual absl::StatusOr<bool> PromoteOver(const security::ModelVersionName& name,
                                           const std::optional<security::ModelVersionName>& before,
                                           const Maker& maker) = 0;

  // Stores a report, without its sampled examples, beside the version that it names, and replaces
  // an earlier report on the same dataset. NOT_FOUND if the version is gone.
  virtual absl::Status KeepReport(const v1::EvaluationReport& report, const Maker& maker) = 0;
  // Returns the report of a version on a dataset. NOT_FOUND if there is none.
  virtual absl::StatusOr<v1::EvaluationReport> GetReport(
      const security::EvaluationName& name) const = 0;

  // Removes a version. FAILED_PRECONDITION while an alias points to it.
  virtual absl::Status Delete(const security::ModelVersionName& name) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_MODEL_VERSIONS_H_
