#include "server/jobs/job_promotion.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "server/errors/error_details.h"
#include "server/jobs/job_folder.h"
#include "server/jobs/job_requests.h"
#include "server/jobs/job_settings.h"
#include "server/jobs/job_time.h"
#include "server/jobs/measurement.h"
#include "server/jobs/trainer_outcome.h"
#include "server/monitoring/logging.h"
#include "server/security/resource_name.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

// Returns the name of the version that serves models/{model}; empty: none does.
std::string ServingName(const serving::ModelVersions& versions, const std::string& model) {
  const auto serving = versions.Serving(security::IdOf(model));
  return serving ? serving->ToString() : std::string();
}

// Returns what publishing decided.
v1::PromotionDecision AsPublished(const v1::Job& job, const VersionRequest& request,
                                  const serving::ModelVersions& versions) {
  v1::PromotionDecision decision;
  if (request.promotion == v1::PROMOTION_NEVER) {
    decision.set_reason("the request said never");
    return decision;
  }
  decision.set_promoted(true);
  if (request.promotion == v1::PROMOTION_ALWAYS) {
    decision.set_reason("it was to be in any case");
    return decision;
  }
  const std::string serving = ServingName(versions, request.model);
  decision.set_promoted(serving == job.model_version());
  if (decision.promoted()) {
    decision.set_reason(absl::StrCat("no version of ", request.model, " served"));
  } else {
    decision.set_reason(serving.empty() ? "the alias was deleted meanwhile"
                                        : absl::StrCat(serving, " serves"));
  }
  return decision;
}

void Record(v1::Job& job, v1::PromotionDecision decision, absl::Time now) {
  *decision.mutable_decide_time() = ToTimestamp(now);
  monitoring::Log(monitoring::LogLevel::kInfo, "promotion decided",
                  {{"job", job.name()},
                   {"model_version", job.model_version()},
                   {"promoted", decision.promoted()},
                   {"reason", decision.reason()}});
  *job.mutable_promotion_decision() = std::move(decision);
}

}  // namespace

void DecideAgainstPromotion(v1::Job& job, const absl::Status& why, absl::Time now) {
  v1::PromotionDecision decision;
  decision.set_reason(absl::StrCat("it was not measured: ", std::string(why.message())));
  *decision.mutable_error() = errors::ToProto(why);
  Record(job, std::move(decision), now);
}

JobPromotion::JobPromotion(v1::Job& job, fs::path folder, const JobAttempt& attempt)
    : job_(job),
      folder_(std::move(folder)),
      attempt_(attempt),
      request_(VersionRequestOf(job)),
      criteria_(ResolveCriteria(request_.criteria)) {}

absl::StatusOr<PromotionTask> JobPromotion::Task() const {
  const auto dataset = attempt_.environment.datasets->Read(security::IdOf(criteria_.dataset()));
  if (!dataset.ok()) return WithDefaultReason(dataset.status(), "UNUSABLE_DATA");
  return PromotionTask{request_.model, job_.model_version(), criteria_,
                       data::ContentSha256(*dataset)};
}

std::vector<std::string> JobPromotion::TrainerOptions() {
  if (!IsByMeasurement()) return {};
  const std::string serving = Serving();
  const absl::StatusOr<PromotionTask> task = Task();
  if (serving.empty() || !task.ok()) return {};
  const size_t count = VersionsToMeasure(*task, *this).size();
  const auto version = ResolveReference(*attempt_.environment.versions, serving);
  if (count == 0 || !version.ok() || !WriteSettings(criteria_.examples(), folder_).ok()) return {};
  const std::string dataset = security::IdOf(criteria_.dataset());
  return {"--next-model",    version->folder,
          "--next-dataset",  attempt_.environment.datasets->FolderOf(dataset),
          "--next-settings", folder_ / kSettingsFile,
          "--next-count",    absl::StrCat(count)};
}

void JobPromotion::DecideAsPublished() {
  Record(job_, AsPublished(job_, request_, *attempt_.environment.versions), attempt_.now());
}

void JobPromotion::DecideAgainst(const absl::Status& why) {
  DecideAgainstPromotion(job_, why, attempt_.now());
}

Outcome JobPromotion::Conclude(PromotionOutcome outcome) {
  if (outcome.decision) {
    Record(job_, *std::move(outcome.decision), attempt_.now());
    return {};
  }
  return {std::move(outcome.interruption), last_died_};
}

std::string JobPromotion::Serving() {
  return ServingName(*attempt_.environment.versions, request_.model);
}

absl::StatusOr<v1::EvaluationReport> JobPromotion::FindReport(const std::string& version) {
  if (const auto found = measured_.find(version); found != measured_.end()) return found->second;
  const auto name = security::ParseModelVersionName(version, "model_version");
  if (!name.ok()) return name.status();
  const auto dataset = security::ParseDatasetName(criteria_.dataset(), "dataset");
  if (!dataset.ok()) return dataset.status();
  return attempt_.environment.versions->GetReport({*name, *dataset});
}

PromotionVersions::MeasuredVersion JobPromotion::Measure(const std::string& version) {
  if (const absl::StatusOr<PromotionTask> task = Task(); task.ok()) {
    // This one is among them, unless it came to serve just now.
    const size_t left = VersionsToMeasure(*task, *this).size();
    attempt_.progress.SetRest(std::max(1, static_cast<int>(left)));
  }
  if (absl::Status status = WriteSettings(criteria_.examples(), folder_); !status.ok()) {
    return {std::move(status), false, {}};
  }
  Measured measured = jobs::Measure(job_, {version, criteria_.dataset(), 0}, folder_, attempt_);
  last_died_ = measured.outcome.died;
  if (measured.report) measured_[version] = *measured.report;
  const bool interrupted =
      measured.outcome.died || attempt_.IsStopped() || errors::IsStoreAway(measured.outcome.status);
  return {std::move(measured.outcome.status), interrupted,
          std::move(measured.report).value_or(v1::EvaluationReport())};
}

absl::StatusOr<bool> JobPromotion::Promote(const std::string& version, const std::string& before) {
  serving::ModelVersions& versions = *attempt_.environment.versions;
  const auto name = security::ParseModelVersionName(version, "model_version");
  if (!name.ok()) return name.status();
  if (before.empty()) return versions.PromoteOver(*name, std::nullopt, attempt_.maker);
  const auto serving = security::ParseModelVersionName(before, "model_version");
  if (!serving.ok()) return serving.status();
  return versions.PromoteOver(*name, *serving, attempt_.maker);
}

absl::Status JobPromotion::Remember(const v1::PromotionDecision& decision) {
  std::error_code ignored;  // the file's error says more
  fs::create_directories(folder_, ignored);
  std::string json;
  (void)google::protobuf::util::MessageToJsonString(decision, &json);
  return files::WriteFileAtomically(folder_ / kDecisionFile, json + "\n");
}

std::optional<v1::PromotionDecision> JobPromotion::Remembered() {
  const auto json = files::ReadFile(folder_ / kDecisionFile);
  v1::PromotionDecision decision;
  if (!json.ok() || !google::protobuf::util::JsonStringToMessage(*json, &decision).ok()) {
    return std::nullopt;
  }
  return decision;
}

}  // namespace maneuver::jobs
