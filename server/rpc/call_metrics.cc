#include "server/rpc/call_metrics.h"

#include <array>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <string_view>

namespace maneuver::rpc {
namespace {

using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using monitoring::Counter;
using monitoring::MetricRegistry;

constexpr std::array<const char*, 17> kCodes = {
    "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
    "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
    "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
    "DATA_LOSS", "UNAUTHENTICATED"};

class MethodMetrics {
 public:
  MethodMetrics(MetricRegistry& metrics, const std::string& method)
      : metrics_(metrics),
        method_(method),
        in_flight_(metrics.AddGauge("maneuver_requests_in_flight", "Calls being answered.",
                                    {{"method", method}})),
        duration_(metrics.AddHistogram("maneuver_request_duration_seconds",
                                       "Time from the start of a call to its status.",
                                       monitoring::TimeBuckets(), {{"method", method}})) {
    Requests(grpc::StatusCode::OK);  // there from the start, at zero
  }

  void Begin() { in_flight_.Add(1.0); }

  void End(grpc::StatusCode code, std::chrono::nanoseconds time) {
    in_flight_.Add(-1.0);
    duration_.Observe(std::chrono::duration<double>(time).count());
    Requests(code).Increment();
  }

 private:
  // Made when it is first needed: most methods only ever see a few codes.
  Counter& Requests(grpc::StatusCode code) {
    const bool known = code >= 0 && static_cast<size_t>(code) < kCodes.size();
    const size_t index = static_cast<size_t>(known ? code : grpc::StatusCode::UNKNOWN);
    Counter* counter = requests_[index].load(std::memory_order_acquire);
    if (counter == nullptr) {
      counter = &metrics_.AddCounter("maneuver_requests_total", "Calls by method and status code.",
                                     {{"method", method_}, {"code", kCodes[index]}});
      requests_[index].store(counter, std::memory_order_release);
    }
    return *counter;
  }

  MetricRegistry& metrics_;
  const std::string method_;
  monitoring::Gauge& in_flight_;
  monitoring::Histogram& duration_;
  std::array<std::atomic<Counter*>, kCodes.size()> requests_{};
};

// Lives as long as its call.
class CallInterceptor final : public grpc::experimental::Interceptor {
 public:
  explicit CallInterceptor(MethodMetrics& metrics)
      : metrics_(metrics), start_(std::chrono::steady_clock::now()) {
    metrics_.Begin();
  }
  // A call that broke off before it was given a status was cancelled.
  ~CallInterceptor() override { End(grpc::StatusCode::CANCELLED); }

  void Intercept(InterceptorBatchMethods* batch) override {
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
      End(batch->GetSendStatus().error_code());
    }
    batch->Proceed();
  }

 private:
  void End(grpc::StatusCode code) {
    if (!ended_.exchange(true)) metrics_.End(code, std::chrono::steady_clock::now() - start_);
  }

  MethodMetrics& metrics_;
  const std::chrono::steady_clock::time_point start_;
  std::atomic<bool> ended_ = false;
};

class CallCounter final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit CallCounter(MetricRegistry& metrics) : metrics_(metrics) {}

  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override {
    return new CallInterceptor(Find(info->method()));
  }

 private:
  // gRPC makes interceptors for registered methods alone, so the labels are bounded.
  MethodMetrics& Find(std::string_view full_name) {
    const std::lock_guard lock(mutex_);
    if (const auto found = methods_.find(full_name); found != methods_.end()) return *found->second;
    // "/maneuver.v1.PredictionService/Predict"
    const size_t slash = full_name.rfind('/');
    const size_t dot = full_name.rfind('.', slash);
    const std::string method(dot == std::string_view::npos ? full_name : full_name.substr(dot + 1));
    return *methods_
                .emplace(std::string(full_name), std::make_unique<MethodMetrics>(metrics_, method))
                .first->second;
  }

  MetricRegistry& metrics_;
  std::mutex mutex_;  // guards methods_, whose elements never move
  std::map<std::string, std::unique_ptr<MethodMetrics>, std::less<>> methods_;
};

}  // namespace

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> CountCalls(
    MetricRegistry& metrics) {
  return std::make_unique<CallCounter>(metrics);
}

}  // namespace maneuver::rpc
