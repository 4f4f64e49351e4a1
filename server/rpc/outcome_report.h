// Scores the outcomes of one request: finds or computes each prediction, measures it against what
// followed, and counts the result in the metrics.

#ifndef MANEUVER_SERVER_RPC_OUTCOME_REPORT_H_
#define MANEUVER_SERVER_RPC_OUTCOME_REPORT_H_

#include <functional>

#include "absl/status/status.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "server/rpc/prediction_run.h"
#include "server/serving/outcome_collection.h"
#include "server/serving/outcome_metrics.h"

namespace maneuver::rpc {

// The most targets of one request.
inline constexpr int kMostOutcomes = 256;

// Returns how many targets the request has.
int CountTargets(const v1::ReportOutcomesRequest& request);

// Scores the request's outcomes. Takes as long as the predictions and the scoring: do not call it
// on gRPC's threads. Each target and each outcome fails alone, except that nothing is counted or
// removed, and the whole call fails, if nobody waits for it any more or if the scheduler refuses
// it. Predictions for scenes have bulk priority.
//   context: `past_answers` may be nullptr
//   cancelled: whether the caller has gone
//   collection: gets the outcomes that came with their scenes, before anything is counted; they are
//     on disk when the call returns OK. May be nullptr
absl::Status ReportOutcomes(PredictionContext& context, serving::OutcomeMetrics& metrics,
                            const v1::ReportOutcomesRequest& request, serving::TimePoint deadline,
                            const std::function<bool()>& cancelled,
                            v1::ReportOutcomesResponse* response,
                            serving::OutcomeCollection* collection = nullptr);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_REPORT_H_
