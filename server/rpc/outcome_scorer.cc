#include "server/rpc/outcome_scorer.h"

#include <chrono>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/files/utf8.h"
#include "server/errors/error_details.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/outcome_report.h"
#include "server/rpc/prediction_admission.h"

namespace maneuver::rpc {
namespace {

// In memory, messages take about four times as much.
constexpr int64_t kMostWaitingBytes = int64_t{128} << 20;

}  // namespace

absl::Status TooManyWait() {
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(
                             "too many outcomes wait for being scored; try again a little later"),
                         "TOO_MANY_REQUESTS"),
      std::chrono::seconds(1));
}

std::shared_ptr<void> OutcomeScorer::Reserve(int64_t bytes) {
  const int64_t all = *bytes_ += bytes;
  const bool fits = all <= kMostWaitingBytes || all == bytes;
  // A pointer that is not null, to nothing: its end, which may come after this object's, frees the
  // memory.
  std::shared_ptr<void> share(this, [reserved = bytes_, bytes](void*) { *reserved -= bytes; });
  return fits ? share : nullptr;
}

absl::Status OutcomeScorer::Admit(const security::Credentials& caller,
                                  const v1::ReportOutcomesRequest& report) {
  if (report.outcomes().empty()) {
    return errors::InvalidField("outcomes", "name at least one outcome");
  }
  if (files::IsLongerThan(report.request_id(), kMostRequestIdLength)) {
    return errors::InvalidField("request_id", "longer than 128 characters");
  }
  const int targets = CountTargets(report);
  if (targets > kMostOutcomes || report.outcomes_size() > kMostOutcomes) {
    return errors::InvalidField(
        "outcomes", absl::StrCat("has ", report.outcomes_size(), " outcomes of ", targets,
                                 " targets; at most ", kMostOutcomes, " are accepted in one call"));
  }
  return context_.access.limits_targets() ? context_.access.AdmitTargets(caller, targets)
                                          : absl::OkStatus();
}

absl::Status OutcomeScorer::Score(const grpc::CallbackServerContext& rpc,
                                  const v1::ReportOutcomesRequest& report,
                                  v1::ReportOutcomesResponse* response) {
  const std::string name = RecentReports::NameOf(report);
  if (!name.empty() && recent_.Find(name, response)) return absl::OkStatus();
  absl::Status status = ReportOutcomes(
      context_, metrics_, report, OnSteadyClock(DeadlineOf(rpc)),
      [&rpc] { return rpc.IsCancelled(); }, response, storage_.collection);
  if (status.ok()) recent_.Keep(name, *response);
  return status;
}

}  // namespace maneuver::rpc
