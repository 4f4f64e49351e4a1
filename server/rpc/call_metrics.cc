#include "server/rpc/call_metrics.h"

#include <utility>

namespace maneuver::rpc {
namespace {

constexpr std::array<const char*, 17> kCodeNames = {
    "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
    "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
    "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
    "DATA_LOSS", "UNAUTHENTICATED"};

size_t IndexOf(grpc::StatusCode code) {
  const bool known = code >= 0 && static_cast<size_t>(code) < kCodeNames.size();
  return static_cast<size_t>(known ? code : grpc::StatusCode::UNKNOWN);
}

// "/maneuver.v1.PredictionService/Predict" without the package.
std::string LabelOf(std::string_view method) {
  const size_t dot = method.rfind('.', method.rfind('/'));
  return std::string(dot == std::string_view::npos ? method : method.substr(dot + 1));
}

}  // namespace

const char* CodeName(grpc::StatusCode code) { return kCodeNames[IndexOf(code)]; }

MethodMetrics::MethodMetrics(monitoring::MetricRegistry& metrics, std::string name,
                             bool of_contract)
    : metrics_(metrics),
      name_(std::move(name)),
      of_contract_(of_contract),
      in_flight_(metrics.AddGauge("maneuver_requests_in_flight", "Calls being answered.",
                                  {{"method", name_}})),
      request_bytes_(of_contract
                         ? metrics.AddCounter("maneuver_request_bytes_total",
                                              "Bytes of the messages received, before encryption.",
                                              {{"method", name_}})
                         : monitoring::Counter::Null()),
      response_bytes_(of_contract
                          ? metrics.AddCounter("maneuver_response_bytes_total",
                                               "Bytes of the messages sent, before encryption.",
                                               {{"method", name_}})
                          : monitoring::Counter::Null()) {
  Of(grpc::StatusCode::OK);  // there from the start, at zero
}

void MethodMetrics::End(grpc::StatusCode code, std::chrono::nanoseconds time) {
  in_flight_.Add(-1.0);
  OfCode& of = Of(code);
  of.requests.Increment();
  of.duration.Observe(std::chrono::duration<double>(time).count());
}

MethodMetrics::OfCode& MethodMetrics::Of(grpc::StatusCode code) {
  const size_t index = IndexOf(code);
  if (OfCode* made = by_code_[index].load(std::memory_order_acquire)) return *made;
  const MutexLock lock(mutex_);
  if (made_[index] == nullptr) {
    const monitoring::Labels labels = {{"method", name_}, {"code", kCodeNames[index]}};
    made_[index] = std::make_unique<OfCode>(OfCode{
        metrics_.AddCounter("maneuver_requests_total", "Calls by method and status code.", labels),
        metrics_.AddHistogram("maneuver_request_duration_seconds",
                              "Time from the start of a call to its status.",
                              monitoring::TimeBuckets(), labels)});
    by_code_[index].store(made_[index].get(), std::memory_order_release);
  }
  return *made_[index];
}

CallMetrics::CallMetrics(monitoring::MetricRegistry& metrics,
                         const std::vector<std::string>& methods,
                         const std::vector<std::string>& others)
    : metrics_(metrics), others_(others.begin(), others.end()) {
  for (const std::string& method : methods) Add(method, /*of_contract=*/true);
}

MethodMetrics& CallMetrics::Find(std::string_view method) {
  const MutexLock lock(mutex_);
  if (const auto found = methods_.find(method); found != methods_.end()) return *found->second;
  if (others_.contains(method)) return Add(method, /*of_contract=*/false);
  const auto unknown = methods_.find(kUnknownMethod);
  return unknown != methods_.end() ? *unknown->second : Add(kUnknownMethod, false);
}

MethodMetrics& CallMetrics::Add(std::string_view method, bool of_contract) {
  return *methods_
              .emplace(std::string(method),
                       std::make_unique<MethodMetrics>(metrics_, LabelOf(method), of_contract))
              .first->second;
}

}  // namespace maneuver::rpc
