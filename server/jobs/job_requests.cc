#include "server/jobs/job_requests.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/artifact/field_rules.h"
#include "model/artifact/training_presets.h"
#include "model/evaluation/metric_table.h"
#include "model/evaluation/rival_table.h"
#include "model/files/digest.h"
#include "model/scene/duration.h"
#include "server/errors/error_details.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

constexpr size_t kMaxRequestId = 128;
constexpr int kMaxDatasets = 100;
constexpr int kMaxSampledExamples = 1000;
constexpr int kMaxCriteria = 20;
constexpr int kMaxSeeds = 20;
constexpr int kMaxFolds = 100;
constexpr int kDefaultFolds = 5;
constexpr int kMostPriority = 100;
constexpr int kMostRanks = 64;
constexpr int kMostParts = 10'000;
constexpr double kMostStride = 3600.0;  // seconds
constexpr char kDatasetRule[] =
    "expected datasets/{dataset}, with ids of lower-case letters, digits and hyphens";

constexpr char kModelRule[] =
    "expected models/{model}, models/{model}@{alias} or models/{model}/versions/{version}";

// The wrong fields of a request: the first 16, and the number of the others.
class Violations {
 public:
  void Add(std::string field, std::string description) {
    found_.Require(false, std::move(field), std::move(description));
  }
  // Adds violations of a part of the request.
  //   prefix: put before each field
  void AddAll(const std::string& prefix, std::vector<scene::FieldViolation> part) {
    found_.Include(prefix, std::move(part));
  }
  bool empty() const { return found_.all_hold(); }
  std::vector<scene::FieldViolation> Take() { return std::move(found_).violations(); }

 private:
  artifact::FieldRules found_;
};

void CheckRequestId(const std::string& request_id, Violations& violations) {
  if (request_id.size() > kMaxRequestId) {
    violations.Add("request_id", absl::StrCat("must have at most ", kMaxRequestId, " bytes"));
  }
}

void CheckPriority(int priority, Violations& violations) {
  if (priority < -kMostPriority || priority > kMostPriority) {
    violations.Add("priority", absl::StrCat("expected -", kMostPriority, " to ", kMostPriority));
  }
}

void CheckCriteria(const v1::PromotionCriteria& criteria, bool with_baselines,
                   Violations& violations) {
  const std::string field = "promotion_criteria.";
  if (!security::ParseDatasetName(criteria.dataset(), field + "dataset").ok()) {
    violations.Add(field + "dataset", kDatasetRule);
  }
  if (criteria.metrics_size() > kMaxCriteria) {
    violations.Add(field + "metrics", absl::StrCat("must be at most ", kMaxCriteria));
    return;
  }
  std::set<std::string> seen;
  for (int i = 0; i < criteria.metrics_size(); ++i) {
    const v1::MetricCriterion& criterion = criteria.metrics(i);
    const std::string metric = absl::StrCat(field, "metrics[", i, "].metric");
    if (!evaluation::CanDecide(criterion.metric())) {
      violations.Add(
          metric, "is not a metric of the model's own that has a better side, such as min_ade_6");
    } else if (!seen.insert(criterion.metric()).second) {
      violations.Add(metric, "is named before");
    }
    if (!(criterion.tolerance() >= 0.0) || !std::isfinite(criterion.tolerance())) {
      violations.Add(absl::StrCat(field, "metrics[", i, "].tolerance"),
                     "must be 0 or more, in the metric's unit");
    }
  }
  std::vector<scene::FieldViolation> faults;
  CheckRequirements(criteria.rivals(), field + "rivals", faults);
  violations.AddAll("", std::move(faults));
  if (criteria.rivals_size() > kMaxCriteria) return;
  for (int i = 0; i < criteria.rivals_size() && !with_baselines; ++i) {
    const evaluation::Rival* rival = evaluation::FindRival(criteria.rivals(i).rival());
    if (rival == nullptr || !rival->trained) continue;
    violations.Add(absl::StrCat(field, "rivals[", i, "].rival"),
                   "is only trained and measured with settings.baselines");
  }
  if (criteria.examples().dataset_weights_size() > 0) {
    violations.Add(field + "examples.dataset_weights", "applies only to training");
  }
  v1::TrainingSettings settings;
  *settings.mutable_examples() = criteria.examples();
  violations.AddAll(
      field, artifact::ValidateTrainingSettings(artifact::ResolveTrainingSettings(settings)));
}

// Checks the promotion of a request that makes a version.
//   with_baselines: whether the version has baselines, as far as the request says
template <typename Request>
void CheckPromotion(const Request& request, bool with_baselines, Violations& violations) {
  if (!v1::Promotion_IsValid(request.promotion())) {
    violations.Add("promotion", "is not a promotion that this server knows");
  }
  if (request.promotion() == v1::PROMOTION_IF_NO_WORSE) {
    CheckCriteria(request.promotion_criteria(), with_baselines, violations);
  } else if (request.has_promotion_criteria()) {
    violations.Add("promotion_criteria", "only goes with PROMOTION_IF_NO_WORSE");
  }
}

//   datasets: how many the request names
void CheckWeights(const v1::TrainingSettings& settings, int datasets, Violations& violations) {
  const int weights = settings.examples().dataset_weights_size();
  if (weights == 0 || weights == datasets) return;
  violations.Add("settings.examples.dataset_weights",
                 absl::StrCat("has ", weights, " weights for ", datasets, " datasets"));
}

void CheckRanks(const v1::TrainRequest& request, Violations& violations) {
  const int ranks = request.ranks();
  if (ranks == 0) return;
  if (ranks < 0 || ranks > kMostRanks || !std::has_single_bit(static_cast<unsigned>(ranks))) {
    violations.Add("ranks", absl::StrCat("must be 0 or a power of two up to ", kMostRanks));
    return;
  }
  const int set = request.settings().optimization().micro_batches();
  const int micro_batches = set == 0 ? artifact::kMicroBatchesOfRanks : set;
  if (micro_batches % ranks != 0) {
    violations.Add("ranks", absl::StrCat("cannot divide the ", micro_batches,
                                         " of settings.optimization.micro_batches"));
  }
}

// Checks that there are not too many names, that each is one, and that none is in `seen`; adds them
// there.
void CheckDatasets(const google::protobuf::RepeatedPtrField<std::string>& names,
                   const std::string& field, std::set<std::string>& seen, Violations& violations) {
  if (names.size() > kMaxDatasets) {
    violations.Add(field, absl::StrCat("must be at most ", kMaxDatasets));
    return;
  }
  for (int i = 0; i < names.size(); ++i) {
    const std::string each = absl::StrCat(field, "[", i, "]");
    if (!security::ParseDatasetName(names[i], each).ok()) {
      violations.Add(each, kDatasetRule);
    } else if (!seen.insert(names[i]).second) {
      violations.Add(each, "is named before");
    }
  }
}

void CheckSeeds(const v1::CrossValidateRequest& request, Violations& violations) {
  if (request.seeds_size() > kMaxSeeds) {
    violations.Add("seeds", absl::StrCat("must be at most ", kMaxSeeds));
    return;
  }
  std::set<int64_t> seen;
  for (int i = 0; i < request.seeds_size(); ++i) {
    if (request.seeds(i) >= 0 && seen.insert(request.seeds(i)).second) continue;
    violations.Add(absl::StrCat("seeds[", i, "]"),
                   request.seeds(i) < 0 ? "must be 0 or more" : "is named before");
  }
}

void AddOfSettings(std::vector<scene::FieldViolation> found, Violations& violations) {
  violations.AddAll("settings.", std::move(found));
}

absl::Status Checked(Violations& violations) {
  return violations.empty() ? absl::OkStatus() : errors::InvalidFields(violations.Take());
}

// The same bytes for equal messages, maps included.
std::string DigestOf(const google::protobuf::Message& message) {
  std::string bytes = message.GetTypeName();
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  return files::Sha256Hex(bytes);
}

template <typename Request>
std::string DigestOfRequest(Request request) {
  request.clear_request_id();
  request.clear_validate_only();
  return DigestOf(request);
}

}  // namespace

void CheckRequirements(const evaluation::RivalRequirements& requirements, const std::string& field,
                       std::vector<scene::FieldViolation>& violations) {
  if (requirements.size() > kMaxCriteria) {
    violations.push_back({field, absl::StrCat("must be at most ", kMaxCriteria)});
    return;
  }
  for (int i = 0; i < requirements.size(); ++i) {
    evaluation::RequirementFault fault = evaluation::CheckRequirement(requirements[i]);
    if (fault.field.empty()) continue;
    violations.push_back(
        {absl::StrCat(field, "[", i, "].", fault.field), std::move(fault.description)});
  }
}

absl::Status CheckTrainRequest(const v1::TrainRequest& request) {
  Violations violations;
  if (!security::ParseModelName(request.model(), "model").ok()) {
    violations.Add("model",
                   "expected models/{model}, with ids of lower-case letters, digits and hyphens");
  }
  if (request.datasets().empty()) violations.Add("datasets", "must name at least one");
  std::set<std::string> seen;
  CheckDatasets(request.datasets(), "datasets", seen, violations);
  CheckPromotion(request, request.settings().baselines(), violations);
  CheckRequestId(request.request_id(), violations);
  CheckPriority(request.priority(), violations);
  CheckWeights(request.settings(), request.datasets_size(), violations);
  CheckRanks(request, violations);
  if (request.start_from().empty()) {
    const auto settings = artifact::ResolveTrainingSettings(request.settings());
    AddOfSettings(artifact::ValidateTrainingSettings(settings), violations);
  } else if (!security::ParseModelReference(request.start_from(), "start_from").ok()) {
    violations.Add("start_from", kModelRule);
  }
  return Checked(violations);
}

absl::Status CheckStart(const v1::TrainRequest& request, const v1::ModelSpec& start) {
  Violations violations;
  AddOfSettings(artifact::ValidateStart(request.settings(), start), violations);
  const auto settings = artifact::ResolveTrainingSettings(request.settings(), start);
  AddOfSettings(artifact::ValidateTrainingSettings(settings), violations);
  return Checked(violations);
}

absl::StatusOr<serving::ModelVersions::ResolvedVersion> ResolveReference(
    const serving::ModelVersions& versions, const std::string& reference) {
  const auto parsed = security::ParseOptionalModelReference(reference, "model");
  if (!parsed.ok()) return parsed.status();
  return versions.Resolve(*parsed);
}

absl::Status CheckEvaluateRequest(const v1::EvaluateRequest& request) {
  Violations violations;
  if (!request.model().empty() && !security::ParseModelReference(request.model(), "model").ok()) {
    violations.Add("model", kModelRule);
  }
  if (!security::ParseDatasetName(request.dataset(), "dataset").ok()) {
    violations.Add("dataset", kDatasetRule);
  }
  if (request.examples().dataset_weights_size() > 0) {
    violations.Add("examples.dataset_weights", "applies only to training");
  }
  if (request.sampled_examples() < 0 || request.sampled_examples() > kMaxSampledExamples) {
    violations.Add("sampled_examples", absl::StrCat("must be 0 to ", kMaxSampledExamples));
  }
  CheckRequestId(request.request_id(), violations);
  CheckPriority(request.priority(), violations);
  v1::TrainingSettings settings;
  *settings.mutable_examples() = request.examples();
  // examples.... in both messages.
  violations.AddAll(
      "", artifact::ValidateTrainingSettings(artifact::ResolveTrainingSettings(settings)));
  return Checked(violations);
}

absl::Status CheckCrossValidateRequest(const v1::CrossValidateRequest& request) {
  Violations violations;
  if (request.datasets().empty()) violations.Add("datasets", "must name at least one");
  std::set<std::string> seen;
  CheckDatasets(request.datasets(), "datasets", seen, violations);
  CheckDatasets(request.test_datasets(), "test_datasets", seen, violations);
  if (request.folds() != 0 && (request.folds() < 2 || request.folds() > kMaxFolds)) {
    violations.Add("folds", absl::StrCat("must be 2 to ", kMaxFolds, ", or 0 for ", kDefaultFolds));
  }
  if (request.fold_seed() < 0) violations.Add("fold_seed", "must be 0 or more");
  CheckSeeds(request, violations);
  CheckRequestId(request.request_id(), violations);
  CheckPriority(request.priority(), violations);
  CheckWeights(request.settings(), request.datasets_size(), violations);
  AddOfSettings(
      artifact::ValidateTrainingSettings(artifact::ResolveTrainingSettings(request.settings())),
      violations);
  return Checked(violations);
}

absl::Status CheckRecalibrateRequest(const v1::RecalibrateRequest& request) {
  Violations violations;
  if (!request.model().empty() && !security::ParseModelReference(request.model(), "model").ok()) {
    violations.Add("model", kModelRule);
  }
  if (request.datasets().empty()) violations.Add("datasets", "must name at least one");
  std::set<std::string> seen;
  CheckDatasets(request.datasets(), "datasets", seen, violations);
  if (request.examples().dataset_weights_size() > 0) {
    violations.Add("examples.dataset_weights", "applies only to training");
  }
  // A version keeps the baselines that it has.
  CheckPromotion(request, /*with_baselines=*/true, violations);
  CheckRequestId(request.request_id(), violations);
  CheckPriority(request.priority(), violations);
  v1::TrainingSettings settings;
  *settings.mutable_examples() = request.examples();
  // examples.... in both messages.
  violations.AddAll(
      "", artifact::ValidateTrainingSettings(artifact::ResolveTrainingSettings(settings)));
  return Checked(violations);
}

absl::Status CheckTagRequest(const v1::TagRequest& request) {
  Violations violations;
  if (!request.model().empty() && !security::ParseModelReference(request.model(), "model").ok()) {
    violations.Add("model", kModelRule);
  }
  if (request.datasets().empty()) violations.Add("datasets", "must name at least one");
  std::set<std::string> seen;
  CheckDatasets(request.datasets(), "datasets", seen, violations);
  if (!security::ParseTagsName(request.tags(), "tags").ok()) {
    violations.Add("tags",
                   "expected tags/{tags}, with ids of lower-case letters, digits and hyphens");
  }
  if (request.parts() < 0 || request.parts() > kMostParts) {
    violations.Add("parts", absl::StrCat("must be at most ", kMostParts, ", or 0 for 1"));
  } else if (request.part() < 0 || request.part() >= PartsOf(request)) {
    violations.Add("part", absl::StrCat("must be 0 to ", PartsOf(request) - 1));
  }
  const double stride = StrideOf(request);
  // JSON, in which tags keep it, has no other.
  const bool is_well_formed =
      request.stride().nanos() >= 0 && request.stride().nanos() < 1'000'000'000;
  if (request.has_stride() &&
      !(is_well_formed && stride >= artifact::kLeastStride && stride <= kMostStride)) {
    violations.Add("stride", absl::StrCat("must be ", artifact::kLeastStride, " to ", kMostStride,
                                          " seconds, with 0 to 999,999,999 nanos"));
  }
  CheckRequestId(request.request_id(), violations);
  CheckPriority(request.priority(), violations);
  return Checked(violations);
}

int FoldsOf(const v1::CrossValidateRequest& request) {
  return request.folds() == 0 ? kDefaultFolds : request.folds();
}

int64_t FoldSeedOf(const v1::CrossValidateRequest& request) {
  return request.has_fold_seed() ? request.fold_seed() : 1;
}

int PartsOf(const v1::TagRequest& request) { return std::max(1, request.parts()); }

double StrideOf(const v1::TagRequest& request) { return scene::ToSeconds(request.stride()); }

v1::Tags NewTags(const v1::Job& job) {
  v1::Tags tags;
  tags.set_model_version(job.tag().model());
  *tags.mutable_datasets() = job.tag().datasets();
  tags.set_windows(job.tag().windows());
  if (job.tag().has_stride()) *tags.mutable_stride() = job.tag().stride();
  *tags.mutable_create_time() = job.create_time();
  return tags;
}

v1::ExampleSettings ResolveExamples(const v1::ExampleSettings& examples) {
  v1::TrainingSettings settings;
  *settings.mutable_examples() = examples;
  return artifact::ResolveTrainingSettings(settings).examples();
}

std::string RequestDigest(v1::TrainRequest request) { return DigestOfRequest(std::move(request)); }
std::string RequestDigest(v1::EvaluateRequest request) {
  return DigestOfRequest(std::move(request));
}

std::string RequestDigest(v1::CrossValidateRequest request) {
  return DigestOfRequest(std::move(request));
}

std::string RequestDigest(v1::RecalibrateRequest request) {
  return DigestOfRequest(std::move(request));
}

std::string RequestDigest(v1::TagRequest request) { return DigestOfRequest(std::move(request)); }

std::vector<std::string> DatasetIds(const v1::Job& job) {
  std::vector<std::string> ids;
  const auto add = [&ids](const std::string& name) { ids.push_back(security::IdOf(name)); };
  if (job.has_train()) {
    for (const std::string& name : job.train().datasets()) add(name);
    if (job.train().has_promotion_criteria()) add(job.train().promotion_criteria().dataset());
  } else if (job.has_recalibrate()) {
    const v1::RecalibrateRequest& request = job.recalibrate();
    for (const std::string& name : request.datasets()) add(name);
    if (request.has_promotion_criteria()) add(request.promotion_criteria().dataset());
  } else if (job.has_cross_validate()) {
    for (const std::string& name : job.cross_validate().datasets()) add(name);
    for (const std::string& name : job.cross_validate().test_datasets()) add(name);
  } else if (job.has_tag()) {
    for (const std::string& name : job.tag().datasets()) add(name);
  } else {
    add(job.evaluate().dataset());
  }
  return ids;
}

}  // namespace maneuver::jobs
