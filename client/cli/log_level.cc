// maneuver log-level: how much the server logs.

#include <array>
#include <memory>
#include <ostream>
#include <utility>

#include "client/cli/commands.h"

namespace maneuver::cli {
namespace {

constexpr std::array<std::pair<const char*, v1::LogLevel>, 4> kLevels = {
    {{"debug", v1::LOG_LEVEL_DEBUG},
     {"info", v1::LOG_LEVEL_INFO},
     {"warning", v1::LOG_LEVEL_WARNING},
     {"error", v1::LOG_LEVEL_ERROR}}};

const char* NameOf(v1::LogLevel level) {
  for (const auto& [name, value] : kLevels) {
    if (value == level) return name;
  }
  return "unknown";
}

int ShowLevel(Environment& environment) {
  const auto answer = environment.server_client().GetLogLevel({}, environment.call_options());
  if (!answer.ok()) return environment.FailCall(answer.status());
  if (environment.json()) {
    environment.PrintJson(*answer);
  } else {
    environment.out << NameOf(answer->level()) << "\n";
  }
  return kOk;
}

int Change(const std::string& level, Environment& environment) {
  v1::SetLogLevelRequest request;
  for (const auto& [name, value] : kLevels) {
    if (name == level) request.set_level(value);
  }
  if (request.level() == v1::LOG_LEVEL_UNSPECIFIED) {
    return environment.Refuse("LEVEL is one of debug, info, warning and error");
  }
  const auto answer = environment.server_client().SetLogLevel(request, environment.call_options());
  if (!answer.ok()) return environment.FailCall(answer.status());
  if (environment.json()) {
    environment.PrintJson(*answer);
  } else {
    environment.out << level << ", before: " << NameOf(answer->previous_level()) << "\n";
  }
  return kOk;
}

}  // namespace

void AddLogLevel(Command& root, Environment& environment) {
  const auto level = std::make_shared<std::string>();
  Command command = root.Add(
      "log-level", "Show or change how much the server logs",
      "debug has a line for each call. Needs the role admin. Lasts until the server ends.\n"
      "Example: maneuver log-level debug");
  command.OptionalArgument("LEVEL", level.get(), "debug, info, warning or error; none: show it");
  command.Run([level, &environment] {
    return level->empty() ? ShowLevel(environment) : Change(*level, environment);
  });
}

}  // namespace maneuver::cli
