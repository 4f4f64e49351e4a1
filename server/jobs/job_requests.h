// Checks of the requests that create jobs.

#ifndef MANEUVER_SERVER_JOBS_JOB_REQUESTS_H_
#define MANEUVER_SERVER_JOBS_JOB_REQUESTS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/rival_requirements.h"
#include "model/scene/field_violation.h"
#include "server/serving/model_versions.h"

namespace maneuver::jobs {

// Check a request by itself, without looking up the models and datasets that it names.
// INVALID_ARGUMENT lists the first 16 wrong fields, and says how many more there are.
absl::Status CheckTrainRequest(const v1::TrainRequest& request);
absl::Status CheckEvaluateRequest(const v1::EvaluateRequest& request);
absl::Status CheckCrossValidateRequest(const v1::CrossValidateRequest& request);
absl::Status CheckRecalibrateRequest(const v1::RecalibrateRequest& request);
absl::Status CheckTagRequest(const v1::TagRequest& request);

// Checks that the settings of a request with start_from fit a model of this spec. CheckTrainRequest
// does not check this. INVALID_ARGUMENT lists each wrong field.
absl::Status CheckStart(const v1::TrainRequest& request, const v1::ModelSpec& start);

// Appends each wrong field of `requirements`.
//   field: the path of the requirements in the request, such as "requirements"
void CheckRequirements(const evaluation::RivalRequirements& requirements, const std::string& field,
                       std::vector<scene::FieldViolation>& violations);

// Returns the version that a reference in a request, such as start_from, refers to. An empty one
// refers to the only model that serves. Errors: those of ModelVersions::Resolve.
absl::StatusOr<serving::ModelVersions::ResolvedVersion> ResolveReference(
    const serving::ModelVersions& versions, const std::string& reference);

// Returns example settings with every unset field taken from the default preset.
v1::ExampleSettings ResolveExamples(const v1::ExampleSettings& examples);

// Return a digest that is the same for two requests exactly if they are equal apart from
// request_id and validate_only.
std::string RequestDigest(v1::TrainRequest request);
std::string RequestDigest(v1::EvaluateRequest request);
std::string RequestDigest(v1::CrossValidateRequest request);
std::string RequestDigest(v1::RecalibrateRequest request);
std::string RequestDigest(v1::TagRequest request);

// Return the number of folds and the fold seed, with the defaults for unset fields.
int FoldsOf(const v1::CrossValidateRequest& request);
int64_t FoldSeedOf(const v1::CrossValidateRequest& request);

// Returns the number of parts, with its default.
int PartsOf(const v1::TagRequest& request);
// Returns the stride, seconds; 0 if it is unset.
double StrideOf(const v1::TagRequest& request);
// Returns the tags that a tagging job makes, as they begin.
v1::Tags NewTags(const v1::Job& job);

// Returns the ids of the datasets that a job reads.
std::vector<std::string> DatasetIds(const v1::Job& job);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_REQUESTS_H_
