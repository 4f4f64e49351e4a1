#include "server/jobs/promotion_run.h"

#include <google/protobuf/util/json_util.h>

#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "model/data/dataset_folder.h"
#include "model/files/durable_file.h"
#include "server/jobs/job_time.h"
#include "server/jobs/promotion.h"
#include "server/monitoring/logging.h"

namespace maneuver::jobs {
namespace {

namespace fs = std::filesystem;

constexpr char kDecisionFile[] = "decision.json";

// Returns the name of the version that serves models/{model}; empty: none does.
std::string ServingName(const serving::ModelVersions& versions, const std::string& model) {
  const auto serving = versions.Serving(std::string(absl::StripPrefix(model, "models/")));
  return serving ? serving->ToString() : std::string();
}

class JobPromotion final : public PromotionSteps {
 public:
  JobPromotion(v1::Job& job, const PromotionTask& task, fs::path folder, const JobAttempt& attempt)
      : job_(job), task_(task), folder_(std::move(folder)), attempt_(attempt) {}

  std::string Serving() override { return ServingName(versions(), task_.model); }

  absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) override {
    const auto name = security::ParseModelVersionName(version, "model_version");
    if (!name.ok()) return name.status();
    const auto dataset = security::ParseDatasetName(task_.criteria.dataset(), "dataset");
    if (!dataset.ok()) return dataset.status();
    return versions().GetReport({*name, *dataset});
  }

  MeasuredVersion Measure(const std::string& version) override {
    if (version == task_.version) {
      attempt_.progress.SetPart(kTrainedAt, kMeasuredAt);
    } else {
      attempt_.progress.SetPart(kMeasuredAt, 1.0);
    }
    Measured measured = jobs::Measure(
        job_, {version, task_.criteria.dataset(), task_.criteria.examples(), 0}, folder_, attempt_);
    last_died_ = measured.outcome.died;
    const bool stopped = attempt_.stop.reason() != StopRequest::Reason::kNone;
    return {std::move(measured.outcome.status), measured.outcome.died || stopped,
            std::move(measured.report).value_or(v1::EvaluationReport())};
  }

  absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) override {
    const auto name = security::ParseModelVersionName(version, "model_version");
    if (!name.ok()) return name.status();
    if (before.empty()) return versions().PromoteOver(*name, std::nullopt);
    const auto serving = security::ParseModelVersionName(before, "model_version");
    if (!serving.ok()) return serving.status();
    return versions().PromoteOver(*name, *serving);
  }

  absl::Status Remember(const v1::PromotionDecision& decision) override {
    std::error_code ignored;  // of a folder that is there; the file's error says more
    fs::create_directories(folder_, ignored);
    std::string json;
    (void)google::protobuf::util::MessageToJsonString(decision, &json);
    return files::WriteFileAtomically(folder_ / kDecisionFile, json + "\n");
  }

  std::optional<v1::PromotionDecision> Remembered() override {
    const auto json = files::ReadFile(folder_ / kDecisionFile);
    v1::PromotionDecision decision;
    if (!json.ok() || !google::protobuf::util::JsonStringToMessage(*json, &decision).ok()) {
      return std::nullopt;
    }
    return decision;
  }

  bool last_died() const { return last_died_; }

 private:
  serving::ModelVersions& versions() const { return *attempt_.environment.versions; }

  v1::Job& job_;
  const PromotionTask& task_;
  const fs::path folder_;
  const JobAttempt& attempt_;
  bool last_died_ = false;
};

void Record(v1::Job& job, v1::PromotionDecision decision, absl::Time now) {
  *decision.mutable_decide_time() = ToTimestamp(now);
  monitoring::Log(monitoring::LogLevel::kInfo, "promotion decided",
                  {{"job", job.name()},
                   {"model_version", job.model_version()},
                   {"promoted", decision.promoted()},
                   {"reason", decision.reason()}});
  *job.mutable_promotion_decision() = std::move(decision);
}

// What publishing did.
v1::PromotionDecision AsPublished(const v1::Job& job, const serving::ModelVersions& versions) {
  v1::PromotionDecision decision;
  const v1::TrainRequest& request = job.train();
  if (request.promotion() == v1::PROMOTION_NEVER) {
    decision.set_reason("it was never to be");
    return decision;
  }
  decision.set_promoted(true);
  if (request.promotion() == v1::PROMOTION_ALWAYS) {
    decision.set_reason("it was to be in any case");
    return decision;
  }
  const std::string serving = ServingName(versions, request.model());
  decision.set_promoted(serving == job.model_version());
  if (decision.promoted()) {
    decision.set_reason(absl::StrCat("no version of ", request.model(), " served"));
  } else {
    decision.set_reason(serving.empty() ? "the alias was deleted meanwhile"
                                        : absl::StrCat(serving, " serves"));
  }
  return decision;
}

}  // namespace

Outcome RunPromotion(v1::Job& job, const fs::path& folder, const JobAttempt& attempt) {
  const v1::TrainRequest& request = job.train();
  if (request.promotion() != v1::PROMOTION_IF_NO_WORSE) {
    Record(job, AsPublished(job, *attempt.environment.versions), attempt.now());
    return {};
  }
  PromotionTask task{request.model(), job.model_version(),
                     ResolveCriteria(request.promotion_criteria()), ""};
  const auto dataset = attempt.environment.datasets->Get(
      std::string(absl::StripPrefix(task.criteria.dataset(), "datasets/")));
  if (!dataset.ok()) {
    DecideAgainst(job, WithDefaultReason(dataset.status(), "UNUSABLE_DATA"), attempt.now());
    return {};
  }
  task.dataset_sha256 = data::ContentSha256(*dataset);
  JobPromotion steps(job, task, folder, attempt);
  PromotionOutcome outcome = DecidePromotion(task, steps);
  if (!outcome.decision) return {std::move(outcome.interruption), steps.last_died()};
  Record(job, *std::move(outcome.decision), attempt.now());
  return {};
}

void DecideAgainst(v1::Job& job, const absl::Status& why, absl::Time now) {
  v1::PromotionDecision decision;
  decision.set_reason(absl::StrCat("it was not measured: ", std::string(why.message())));
  *decision.mutable_error() = errors::ToProto(why);
  Record(job, std::move(decision), now);
}

}  // namespace maneuver::jobs
