// Logs calls, with the ids that callers send.

#ifndef MANEUVER_SERVER_RPC_CALL_LOG_H_
#define MANEUVER_SERVER_RPC_CALL_LOG_H_

#include <grpcpp/support/status_code_enum.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "server/security/rate_limiter.h"

namespace maneuver::rpc {

struct CallOrigin {
  std::string request_id;   // the caller's, or one made up here
  std::string traceparent;  // the caller's; empty if it sent none
};

struct CallRecord {
  std::string_view method;  // "PredictionService/Predict"
  grpc::StatusCode code = grpc::StatusCode::OK;
  std::chrono::nanoseconds time{0};
  int64_t request_bytes = 0;
  int64_t response_bytes = 0;
};

// Logs every call at debug, and calls that fail through a fault of the server (UNKNOWN, INTERNAL,
// DATA_LOSS) as errors, at most ten lines per second. A line contains nothing that the caller sent
// except the two fields of CallOrigin, and these only if they are well formed. Thread-safe.
class CallLog {
 public:
  //   seed: distinguishes the ids made up here from those of other servers.
  explicit CallLog(uint32_t seed);

  // Returns the ids of a call. Empty arguments stand for missing headers; malformed ones are
  // ignored.
  //   request_id: header x-request-id: up to 64 letters, digits, '-', '_' and '.'.
  //   traceparent: header of that name, as W3C Trace Context defines it
  //     (www.w3.org/TR/trace-context).
  CallOrigin OriginOf(std::string_view request_id, std::string_view traceparent);

  void Write(const CallRecord& call, const CallOrigin& origin);

 private:
  const std::string prefix_;
  std::atomic<uint64_t> made_up_ = 0;
  security::RateLimiter error_lines_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_CALL_LOG_H_
