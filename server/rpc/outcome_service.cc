#include "server/rpc/outcome_service.h"

#include <chrono>
#include <cstdint>
#include <memory>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"
#include "server/rpc/blocking_call.h"
#include "server/rpc/guarded_service.h"
#include "server/rpc/outcome_report.h"
#include "server/rpc/prediction_admission.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

// Of the requests that wait or are being scored. In memory they take about four times as much.
constexpr int64_t kMostWaitingBytes = int64_t{128} << 20;

// Checks what can be checked without computing anything.
absl::Status Admit(PredictionContext& context, const grpc::CallbackServerContext& rpc,
                   const v1::ReportOutcomesRequest& request) {
  if (request.outcomes().empty()) {
    return errors::InvalidField("outcomes", "name at least one outcome");
  }
  const int targets = CountTargets(request);
  if (targets > kMostOutcomes || request.outcomes_size() > kMostOutcomes) {
    return errors::InvalidField(
        "outcomes", absl::StrCat("has ", request.outcomes_size(), " outcomes of ", targets,
                                 " targets; at most ", kMostOutcomes, " are accepted in one call"));
  }
  return context.access.limits_targets() ? context.access.AdmitTargets(CredentialsOf(rpc), targets)
                                         : absl::OkStatus();
}

absl::Status TooManyWait() {
  return errors::WithRetryDelay(
      errors::WithReason(absl::ResourceExhaustedError(
                             "too many outcomes wait for being scored; try again a little later"),
                         "TOO_MANY_REQUESTS"),
      std::chrono::seconds(1));
}

}  // namespace

OutcomeService::OutcomeService(PredictionContext& context, serving::OutcomeMetrics& metrics,
                               WorkerPool& scoring, const OutcomeStorage& storage)
    : context_(context), metrics_(metrics), scoring_(scoring), storage_(storage) {}

OutcomeService::~OutcomeService() = default;

grpc::ServerUnaryReactor* OutcomeService::ReportOutcomes(grpc::CallbackServerContext* rpc,
                                                         const v1::ReportOutcomesRequest* request,
                                                         v1::ReportOutcomesResponse* response) {
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  if (const absl::Status admitted = Admit(context_, *rpc, *request); !admitted.ok()) {
    reactor->Finish(ToGrpcStatus(admitted));
    return reactor;
  }
  const auto bytes = static_cast<int64_t>(request->ByteSizeLong());
  const std::shared_ptr<void> share(nullptr, [this, bytes](void*) { bytes_ -= bytes; });
  const bool fits = (bytes_ += bytes) <= kMostWaitingBytes;
  const bool accepted = fits && scoring_.Post([this, reactor, rpc, request, response, share] {
    const absl::Status status = maneuver::rpc::ReportOutcomes(
        context_, metrics_, *request, OnSteadyClock(DeadlineOf(*rpc)),
        [rpc] { return rpc->IsCancelled(); }, response, storage_.collection);
    FreeRequest(request);
    reactor->Finish(ToGrpcStatus(status));
  });
  if (!accepted) reactor->Finish(ToGrpcStatus(TooManyWait()));
  return reactor;
}

grpc::ServerUnaryReactor* OutcomeService::CollectOutcomes(grpc::CallbackServerContext* rpc,
                                                          const v1::CollectOutcomesRequest* request,
                                                          v1::CollectOutcomesResponse* response) {
  return AnswerFrom(context_.blocking, rpc, request, [this, request, response] {
    return MakeOutcomeDataset(storage_, *request, response);
  });
}

}  // namespace maneuver::rpc
