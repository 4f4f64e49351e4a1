#include "client/service_config.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace maneuver::client {
namespace {

constexpr int kMostAttempts = 5;  // the most that gRPC makes
// Each failure takes one token and each success returns a tenth of one. With half of the tokens or
// fewer, gRPC retries nothing. So a server that dies with a hundred calls in flight costs none of
// them, and one that stays away does not get four times as many calls.
constexpr char kThrottling[] = R"("retryThrottling":{"maxTokens":200,"tokenRatio":0.1})";

std::string Seconds(absl::Duration time) {
  return absl::StrFormat("\"%.3fs\"", std::max(absl::ToDoubleSeconds(time), 0.001));
}

}  // namespace

std::string ToJson(const ServiceConfig& config) {
  std::vector<std::string> parts;
  if (config.several) {
    parts.emplace_back(R"("loadBalancingConfig":[{"round_robin":{}}])");
    parts.push_back(
        absl::StrCat(R"("healthCheckConfig":{"serviceName":")", config.health_service, "\"}"));
  }
  if (config.retry && config.retry->max_attempts > 1) {
    const RetryPolicy& retry = *config.retry;
    parts.push_back(absl::StrCat(R"("methodConfig":[{"name":[{}],"retryPolicy":{"maxAttempts":)",
                                 std::min(retry.max_attempts, kMostAttempts),
                                 R"(,"initialBackoff":)", Seconds(retry.initial_backoff),
                                 R"(,"maxBackoff":)", Seconds(retry.max_backoff),
                                 R"(,"backoffMultiplier":)", retry.backoff_multiplier,
                                 R"(,"retryableStatusCodes":["UNAVAILABLE","CANCELLED"]}}])"));
    parts.emplace_back(kThrottling);
  }
  if (parts.empty()) return "";
  return absl::StrCat("{", absl::StrJoin(parts, ","), "}");
}

}  // namespace maneuver::client
