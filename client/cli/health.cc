// maneuver health: does the server answer, and is it ready?

#include <memory>
#include <ostream>

#include "client/cli/commands.h"

namespace maneuver::cli {
namespace {

int Health(const std::string& service, Environment& environment) {
  client::CallOptions call = environment.call_options();
  if (!call.timeout) call.timeout = absl::Seconds(5);
  const absl::Status status = environment.server_client().CheckHealth(service, call);
  if (!status.ok()) return environment.FailCall(status);
  if (environment.json()) {
    environment.out << "{\"status\": \"SERVING\"}\n";
  } else {
    environment.out << environment.server << " is ready to serve\n";
  }
  return kOk;
}

}  // namespace

void AddHealth(Command& root, Environment& environment) {
  const auto service = std::make_shared<std::string>();
  Command command =
      root.Add("health", "Check whether the server is ready",
               "The exit status is 0 if it is ready and 1 if not, so scripts can wait for it.\n"
               "Example: until maneuver health; do sleep 1; done\n"
               "         maneuver health maneuver.v1.PredictionService");
  command.OptionalArgument("SERVICE", service.get(),
                           "Check this service instead of the whole server");
  command.Run([service, &environment] { return Health(*service, environment); });
}

}  // namespace maneuver::cli
