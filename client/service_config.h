// Private to the library: gRPC's service config, which says how calls are spread over servers and
// tried again (https://github.com/grpc/grpc/blob/master/doc/service_config.md).

#ifndef MANEUVER_CLIENT_SERVICE_CONFIG_H_
#define MANEUVER_CLIENT_SERVICE_CONFIG_H_

#include <optional>
#include <string>

#include "client/retry.h"

namespace maneuver::client {

struct ServiceConfig {
  bool several = false;             // calls go to all addresses in turn, to those that are SERVING
  std::string health_service = "";  // by the health of this service; empty: the server's
  std::optional<RetryPolicy> retry = {};  // of all methods; nothing: none
};

// As JSON; empty if there is nothing to say.
std::string ToJson(const ServiceConfig& config);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_SERVICE_CONFIG_H_
