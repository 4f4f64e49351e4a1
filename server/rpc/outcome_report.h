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

// Scores the request's outcomes, whose number is already checked. Takes as long as the predictions
// and the scoring: do not call it on gRPC's threads. Predictions for scenes have bulk priority.
//
// Outcomes and targets fail one by one: the response has their errors. The whole call fails if
// nobody waits for it any more (CANCELLED, DEADLINE_EXCEEDED), the scheduler refuses it (errors of
// BatchScheduler::Submit), a model cannot be found or loaded at the moment (UNAVAILABLE), or the
// collection cannot be written. Then no outcome is counted, and no
// kept answer is removed.
//   context: without past_answers, outcomes of kept answers fail with ANSWER_NOT_KEPT
//   cancelled: returns whether the caller has gone; called often
//   collection: gets the outcomes that came with their scenes, before anything is counted; they are
//     on disk when the call returns OK. May be nullptr
absl::Status ReportOutcomes(PredictionContext& context, serving::OutcomeMetrics& metrics,
                            const v1::ReportOutcomesRequest& request, serving::TimePoint deadline,
                            const std::function<bool()>& cancelled,
                            v1::ReportOutcomesResponse* response,
                            serving::OutcomeCollection* collection = nullptr);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_OUTCOME_REPORT_H_
