#include "server/rpc/library_logs.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>

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

void LogOfGrpc(gpr_log_func_args* arguments) {
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

}  // namespace maneuver::rpc
