#include "server/rpc/library_logs.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>

#include <atomic>
#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "server/monitoring/logging.h"

namespace maneuver::rpc {
namespace {

using monitoring::LogLevel;

// Returns "call.cc:123" of "./src/core/lib/surface/call.cc".
std::string Source(std::string_view file, int line) {
  return absl::StrCat(std::string(file.substr(file.find_last_of('/') + 1)), ":", line);
}

void LogLine(LogLevel level, std::string_view library, std::string_view text,
             const std::string& source) {
  monitoring::Log(level, "library message",
                  {{"library", library}, {"text", text}, {"source", source}});
}

std::atomic<bool> lost_listener = false;

void LogOfGrpc(gpr_log_func_args* arguments) {
  // Nothing else tells; the words are those of its tcp_server_posix.cc.
  if (std::string_view(arguments->message).starts_with("Failed accept4")) lost_listener = true;
  const LogLevel level = arguments->severity == GPR_LOG_SEVERITY_ERROR  ? LogLevel::kError
                         : arguments->severity == GPR_LOG_SEVERITY_INFO ? LogLevel::kInfo
                                                                        : LogLevel::kDebug;
  LogLine(level, "grpc", arguments->message, Source(arguments->file, arguments->line));
}

void LogOfProtobuf(google::protobuf::LogLevel severity, const char* file, int line,
                   const std::string& message) {
  const LogLevel level = severity == google::protobuf::LOGLEVEL_INFO      ? LogLevel::kInfo
                         : severity == google::protobuf::LOGLEVEL_WARNING ? LogLevel::kWarning
                                                                          : LogLevel::kError;
  LogLine(level, "protobuf", message, Source(file, line));
}

}  // namespace

void LogLibraryLines() {
  gpr_set_log_function(LogOfGrpc);
  google::protobuf::SetLogHandler(LogOfProtobuf);
}

bool LostListener() { return lost_listener; }

}  // namespace maneuver::rpc
