// /healthz and /readyz: what grpc.health.v1 says, for probes that speak HTTP alone.

#ifndef MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_
#define MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_

#include <functional>
#include <optional>
#include <string_view>

#include "server/monitoring/http_pages.h"

namespace maneuver {

// /healthz. 200 while `is_alive`, 503 otherwise: a server that is not alive is to be started again.
// One that drains, or has no model, is alive.
monitoring::HttpPage LivenessPage(std::function<bool()> is_alive);

// /readyz. 200 if a service is SERVING, 503 if it is NOT_SERVING, 404 if there is none of the name.
// The service is predictions, or the one of the query "service=NAME"; "service=" means the server
// as a whole. 400 for another query.
//   is_serving: as rpc::Server::IsServing.
monitoring::HttpPage ReadinessPage(
    std::function<std::optional<bool>(std::string_view service)> is_serving);

}  // namespace maneuver

#endif  // MANEUVER_SERVER_MANEUVERD_HEALTH_PAGES_H_
