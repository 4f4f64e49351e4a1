#include "server/rpc/admin_service.h"

#include <optional>

#include "server/monitoring/logging.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

using monitoring::LogLevel;

v1::LogLevel ToProto(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return v1::LOG_LEVEL_DEBUG;
    case LogLevel::kInfo:
      return v1::LOG_LEVEL_INFO;
    case LogLevel::kWarning:
      return v1::LOG_LEVEL_WARNING;
    case LogLevel::kError:
      return v1::LOG_LEVEL_ERROR;
  }
  return v1::LOG_LEVEL_UNSPECIFIED;
}

std::optional<LogLevel> FromProto(v1::LogLevel level) {
  for (const LogLevel known :
       {LogLevel::kDebug, LogLevel::kInfo, LogLevel::kWarning, LogLevel::kError}) {
    if (ToProto(known) == level) return known;
  }
  return std::nullopt;
}

}  // namespace

AdminService::AdminService() = default;
AdminService::~AdminService() = default;

grpc::ServerUnaryReactor* AdminService::GetLogLevel(grpc::CallbackServerContext* rpc,
                                                    const v1::GetLogLevelRequest*,
                                                    v1::GetLogLevelResponse* response) {
  response->set_level(ToProto(monitoring::GetLogLevel()));
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerUnaryReactor* AdminService::SetLogLevel(grpc::CallbackServerContext* rpc,
                                                    const v1::SetLogLevelRequest* request,
                                                    v1::SetLogLevelResponse* response) {
  grpc::ServerUnaryReactor* reactor = rpc->DefaultReactor();
  const auto level = FromProto(request->level());
  if (!level) {
    reactor->Finish(
        ToGrpcStatus(errors::InvalidField("level", "expected DEBUG, INFO, WARNING or ERROR")));
    return reactor;
  }
  const LogLevel previous = monitoring::GetLogLevel();
  // The change is logged while the more talkative of both is in force.
  if (*level < previous) monitoring::SetLogLevel(*level);
  monitoring::Log(LogLevel::kWarning, "log level changed",
                  {{"from", monitoring::ToString(previous)}, {"to", monitoring::ToString(*level)}});
  monitoring::SetLogLevel(*level);
  response->set_previous_level(ToProto(previous));
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

}  // namespace maneuver::rpc
