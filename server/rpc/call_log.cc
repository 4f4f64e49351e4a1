#include "server/rpc/call_log.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "server/monitoring/logging.h"
#include "server/rpc/call_metrics.h"

namespace maneuver::rpc {
namespace {

using monitoring::LogLevel;

constexpr double kErrorLinesPerSecond = 10.0;
constexpr size_t kMaxRequestIdLength = 64;

bool IsRequestId(std::string_view text) {
  return !text.empty() && text.size() <= kMaxRequestIdLength &&
         std::ranges::all_of(text, [](char c) {
           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' ||
                  c == '.';
         });
}

bool IsLowerHex(std::string_view text) {
  return text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool IsAllZero(std::string_view text) {
  return text.find_first_not_of('0') == std::string_view::npos;
}

// version-trace-parent-flags: 2, 32, 16 and 2 digits. Later versions may add something.
constexpr size_t kTraceparentLength = 55;

std::string_view Traceparent(std::string_view text) {
  if (text.size() < kTraceparentLength) return {};
  const std::string_view known = text.substr(0, kTraceparentLength);
  const std::string_view version = known.substr(0, 2);
  const std::string_view trace = known.substr(3, 32);
  const std::string_view parent = known.substr(36, 16);
  const std::string_view flags = known.substr(53, 2);
  if (known[2] != '-' || known[35] != '-' || known[52] != '-') return {};
  for (const std::string_view part : {version, trace, parent, flags}) {
    if (!IsLowerHex(part)) return {};
  }
  if (version == "ff" || IsAllZero(trace) || IsAllZero(parent)) return {};
  if (text.size() > known.size() && (version == "00" || text[known.size()] != '-')) return {};
  return known;
}

bool IsFaultOfServer(grpc::StatusCode code) {
  return code == grpc::StatusCode::UNKNOWN || code == grpc::StatusCode::INTERNAL ||
         code == grpc::StatusCode::DATA_LOSS;
}

}  // namespace

CallLog::CallLog(uint32_t seed)
    : prefix_(absl::StrCat(absl::Hex(seed, absl::kZeroPad8), "-")),
      error_lines_(kErrorLinesPerSecond) {}

CallOrigin CallLog::OriginOf(std::string_view request_id, std::string_view traceparent) {
  return {IsRequestId(request_id) ? std::string(request_id) : absl::StrCat(prefix_, ++made_up_),
          std::string(Traceparent(traceparent))};
}

void CallLog::Write(const CallRecord& call, const CallOrigin& origin) {
  const bool is_fault = IsFaultOfServer(call.code);
  const LogLevel level =
      is_fault && !error_lines_.Take("", 1.0) ? LogLevel::kError : LogLevel::kDebug;
  if (!monitoring::WouldLog(level)) return;
  const double seconds = std::chrono::duration<double>(call.time).count();
  const char* const message = is_fault ? "call failed" : "call";
  if (origin.traceparent.empty()) {
    monitoring::Log(level, message,
                    {{"method", call.method},
                     {"code", CodeName(call.code)},
                     {"seconds", seconds},
                     {"request_bytes", call.request_bytes},
                     {"response_bytes", call.response_bytes},
                     {"request_id", origin.request_id}});
  } else {
    monitoring::Log(level, message,
                    {{"method", call.method},
                     {"code", CodeName(call.code)},
                     {"seconds", seconds},
                     {"request_bytes", call.request_bytes},
                     {"response_bytes", call.response_bytes},
                     {"request_id", origin.request_id},
                     {"traceparent", origin.traceparent}});
  }
}

}  // namespace maneuver::rpc
