// Translates the query and the priority of a prediction request into the scheduler's terms.

#ifndef MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_
#define MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_

#include "absl/status/statusor.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "server/serving/prediction_call.h"

namespace maneuver::rpc {

// Returns the actions that a query asks for. INVALID_ARGUMENT names the wrong field by its path in
// the request, such as query.action_ids.ids[0] or query.top_k.
//   actions: how many the model has.
absl::StatusOr<serving::DescribeActions> ParseQuery(const v1::DistributionQuery& query,
                                                    int actions);

// Returns the scheduler's priority. INVALID_ARGUMENT if there is no such priority.
absl::StatusOr<serving::Priority> ParsePriority(v1::Priority priority);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PREDICTION_QUERY_H_
