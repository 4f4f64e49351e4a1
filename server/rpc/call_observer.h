// Counts and logs every call of every service.

#ifndef MANEUVER_SERVER_RPC_CALL_OBSERVER_H_
#define MANEUVER_SERVER_RPC_CALL_OBSERVER_H_

#include <grpcpp/support/server_interceptor.h>

#include <memory>
#include <string>
#include <vector>

#include "server/monitoring/metrics.h"
#include "server/rpc/open_calls.h"

namespace maneuver::rpc {

// Gives calls whose request gRPC could not parse INVALID_ARGUMENT with the reason MALFORMED_MESSAGE,
// and those of an unknown method a message. Counts calls (call_metrics.h) and writes their lines
// (call_log.h). Every answer carries its request id as the trailer x-request-id.
//   methods: all methods of the guarded services, such as "/maneuver.v1.PredictionService/Predict".
//   others: further methods of the server; any other is unknown
//   open: counts the calls until gRPC has closed their streams
// `metrics` and `open` outlive the server.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> ObserveCalls(
    monitoring::MetricRegistry& metrics, const std::vector<std::string>& methods,
    const std::vector<std::string>& others, OpenCalls& open);

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_CALL_OBSERVER_H_
