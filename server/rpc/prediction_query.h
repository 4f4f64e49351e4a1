// What a prediction request asks of each target, in the scheduler's terms.

#ifndef MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_
#define MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "server/serving/prediction_call.h"

namespace maneuver::rpc {

// Returns the actions that a query asks for.
//   actions: how many the model has.
// INVALID_ARGUMENT with the wrong field, from the request: query.action_ids.ids[0], query.top_k.
absl::StatusOr<serving::DescribeActions> ParseQuery(const v1::DistributionQuery& query,
                                                    int actions);

// INVALID_ARGUMENT if there is no such priority.
absl::StatusOr<serving::Priority> ParsePriority(v1::Priority priority);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_
