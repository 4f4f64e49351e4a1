// The pages /healthz and /readyz: the state of grpc.health.v1, for probes that use plain HTTP.

#ifndef MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_
#define MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_

#include <functional>
#include <optional>
#include <string_view>

#include "server/monitoring/http_pages.h"

namespace maneuver {

// Returns /healthz. It answers 200 while `is_alive`, 503 otherwise: a server that is not alive
// should be restarted. A server that drains, or has no model, is alive.
monitoring::HttpPage LivenessPage(std::function<bool()> is_alive);

// Returns /readyz. It answers 200 if a service is SERVING, 503 if it is NOT_SERVING, 404 if there
// is no such service. The service is that of the query "service=NAME"; "service=" means the server
// as a whole. 400 for another query.
//   is_serving: as rpc::Server::IsServing.
//   predicts: without a query the service is predictions; if false, the server as a whole
monitoring::HttpPage ReadinessPage(
    std::function<std::optional<bool>(std::string_view service)> is_serving, bool predicts = true);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_
