// A line of the log for each call, and what it says of where the call came from.

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
  std::string request_id;   // the caller's, or one that was made up
  std::string traceparent;  // the caller's; empty: it sent none
};

struct CallRecord {
  std::string_view method;  // "PredictionService/Predict"
  grpc::StatusCode code = grpc::StatusCode::OK;
  std::chrono::nanoseconds time{0};
  int64_t request_bytes = 0;
  int64_t response_bytes = 0;
};

// Calls that fail by a fault of the server's (UNKNOWN, INTERNAL, DATA_LOSS) are logged as errors,
// at most ten lines a second; all calls at debug. Of what the caller sent, a line has the two
// fields of CallOrigin alone, and these only in their proper form. Thread-safe.
class CallLog {
 public:
  //   seed: sets the ids that are made up apart from those of other servers.
  explicit CallLog(uint32_t seed);

  //   request_id: header x-request-id: up to 64 letters, digits, '-', '_' and '.'.
  //   traceparent: header of that name, as W3C Trace Context defines it
  //     (www.w3.org/TR/trace-context).
  // Empty for none. What has another form is left out.
  CallOrigin OriginOf(std::string_view request_id, std::string_view traceparent);

  void Write(const CallRecord& call, const CallOrigin& origin);

 private:
  const std::string prefix_;
  std::atomic<uint64_t> made_up_ = 0;
  security::RateLimiter error_lines_;
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_CALL_LOG_H_
