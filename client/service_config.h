// Private to the library: gRPC's service config, which controls how calls are spread over servers
// and retried (https://github.com/grpc/grpc/blob/master/doc/service_config.md).

#ifndef MANEUVER_CLIENT_SERVICE_CONFIG_H_
#define MANEUVER_CLIENT_SERVICE_CONFIG_H_

#include <optional>
#include <string>

#include "client/retry.h"

namespace maneuver::client {

struct ServiceConfig {
  bool several = false;             // calls go in turn to all addresses that are SERVING
  std::string health_service = "";  // whose health then counts; empty: the whole server
  // Applies to all methods. gRPC makes at most five attempts and has its own jitter. Unset: no
  // retries.
  std::optional<RetryPolicy> retry = {};
};

// Returns the config as JSON; empty if nothing differs from gRPC's defaults.
std::string ToJson(const ServiceConfig& config);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_SERVICE_CONFIG_H_
