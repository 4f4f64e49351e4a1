// Counts calls by method.

#ifndef MANEUVER_SERVER_RPC_CALL_METRICS_H_
#define MANEUVER_SERVER_RPC_CALL_METRICS_H_

#include <grpcpp/support/status_code_enum.h>

#include <array>
#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "server/monitoring/metrics.h"

namespace maneuver::rpc {

// The label of all methods that the server does not have.
inline constexpr char kUnknownMethod[] = "unknown";

// Returns the name of a code, such as "NOT_FOUND"; "UNKNOWN" for any other number.
const char* CodeName(grpc::StatusCode code);

// Thread-safe.
class MethodMetrics {
 public:
  //   name: the label's value, "PredictionService/Predict".
  //   of_contract: whether it is a method of maneuver.v1, whose message bytes are counted.
  MethodMetrics(monitoring::MetricRegistry& metrics, std::string name, bool of_contract);

  const std::string& name() const { return name_; }
  bool of_contract() const { return of_contract_; }

  // Call Begin and End once for each call, and Received and Sent for each of its messages.
  void Begin() { in_flight_.Add(1.0); }
  void Received(size_t bytes) { request_bytes_.Increment(static_cast<double>(bytes)); }
  void Sent(size_t bytes) { response_bytes_.Increment(static_cast<double>(bytes)); }
  void End(grpc::StatusCode code, std::chrono::nanoseconds time);

 private:
  static constexpr size_t kCodes = 17;
  struct OfCode {
    monitoring::Counter& requests;
    monitoring::Histogram& duration;
  };
  // Returns the metrics of a code, which are made when they are first needed: most methods only
  // ever return a few codes.
  OfCode& Of(grpc::StatusCode code);

  monitoring::MetricRegistry& metrics_;
  const std::string name_;
  const bool of_contract_;
  monitoring::Gauge& in_flight_;
  monitoring::Counter& request_bytes_;
  monitoring::Counter& response_bytes_;
  Mutex mutex_;  // held while metrics of a code are made
  std::array<std::unique_ptr<OfCode>, kCodes> made_ ABSL_GUARDED_BY(mutex_);
  std::array<std::atomic<OfCode*>, kCodes> by_code_{};  // those made so far; else null
};

// Counts calls with these metrics:
//   maneuver_requests_total{method, code}, maneuver_request_duration_seconds{method, code},
//   maneuver_requests_in_flight{method}, maneuver_request_bytes_total{method},
//   maneuver_response_bytes_total{method}
// Thread-safe. The MethodMetrics that it returns live as long as it does.
class CallMetrics {
 public:
  //   methods: all methods of the contract, such as "/maneuver.v1.PredictionService/Predict". They
  //     are shown from the start.
  //   others: further methods of the server
  // `metrics` must outlive this object.
  CallMetrics(monitoring::MetricRegistry& metrics, const std::vector<std::string>& methods,
              const std::vector<std::string>& others);

  // Returns the metrics of a method. All that are in neither list share kUnknownMethod: strangers
  // can call any name, and each would take memory for ever.
  MethodMetrics& Find(std::string_view method);

 private:
  MethodMetrics& Add(std::string_view method, bool of_contract)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  monitoring::MetricRegistry& metrics_;
  const std::set<std::string, std::less<>> others_;
  Mutex mutex_;
  // Its elements never move.
  std::map<std::string, std::unique_ptr<MethodMetrics>, std::less<>> methods_
      ABSL_GUARDED_BY(mutex_);
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_CALL_METRICS_H_
