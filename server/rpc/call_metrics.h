// Counts and times every call of every service, in one place.

#ifndef MANEUVER_SERVER_RPC_CALL_METRICS_H_
#define MANEUVER_SERVER_RPC_CALL_METRICS_H_

#include <grpcpp/support/server_interceptor.h>

#include <memory>

#include "server/monitoring/metrics.h"

namespace maneuver::rpc {

//   maneuver_requests_total{method, code}, maneuver_request_duration_seconds{method},
//   maneuver_requests_in_flight{method}
// with methods as "PredictionService/Predict". `metrics` outlives the server.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> CountCalls(
    monitoring::MetricRegistry& metrics);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_CALL_METRICS_H_
