#include "server/maneuverd/health_pages.h"

#include <utility>

namespace maneuver {
namespace {

using monitoring::HttpAnswer;

constexpr std::string_view kServiceKey = "service=";
constexpr char kPredictions[] = "maneuver.v1.PredictionService";

}  // namespace

monitoring::HttpPage LivenessPage(std::function<bool()> is_alive) {
  return {.path = "/healthz", .make = [is_alive = std::move(is_alive)](std::string_view) {
            return is_alive() ? HttpAnswer{200, "alive\n"} : HttpAnswer{503, "not answering\n"};
          }};
}

monitoring::HttpPage ReadinessPage(
    std::function<std::optional<bool>(std::string_view service)> is_serving, bool predicts) {
  return {
      .path = "/readyz",
      .make = [is_serving = std::move(is_serving), predicts](std::string_view query) -> HttpAnswer {
        std::string_view service = predicts ? kPredictions : std::string_view();
        if (!query.empty()) {
          if (!query.starts_with(kServiceKey)) {
            return {400, "ask for /readyz or /readyz?service=NAME\n"};
          }
          service = query.substr(kServiceKey.size());
        }
        const auto serving = is_serving(service);
        if (!serving) return {404, "no such service\n"};
        return *serving ? HttpAnswer{200, "SERVING\n"} : HttpAnswer{503, "NOT_SERVING\n"};
      }};
}

}  // namespace maneuver
