#include "client/cli/maneuver.h"

#include <algorithm>
#include <sstream>

#include "client/cli/commands.h"
#include "client/cli/completion.h"

namespace maneuver::cli {
namespace {

// Whether errors of the command line itself are to be JSON: they come before options are read.
bool AsksForJson(const std::vector<std::string>& arguments) {
  for (size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == "--output=json") return true;
    if (arguments[i] == "--output" && i + 1 < arguments.size() && arguments[i + 1] == "json") {
      return true;
    }
  }
  return false;
}

int Run(CommandLine& line, const std::vector<std::string>& arguments, Environment& environment) {
  if (!AsksForJson(arguments)) return line.Run(arguments, environment.out, environment.err);
  std::ostringstream usage;
  const int status = line.Run(arguments, environment.out, usage);
  std::string message = usage.str();
  if (message.empty()) return status;
  message.erase(message.find_last_not_of('\n') + 1);
  std::ranges::replace(message, '\n', ' ');
  environment.output = "json";
  environment.Refuse(message);
  return status;
}

}  // namespace

int RunManeuver(const std::vector<std::string>& arguments, Environment& environment) {
  CommandLine line(
      "Client of a Maneuver server: makes datasets, trains models, predicts what vehicles will "
      "do.\n"
      "Answers go to standard output, messages to standard error. Exit status: 0 success, 1 a call "
      "or\n"
      "a part of it failed, 2 invalid command line.\n"
      "maneuver help COMMAND describes a command and its options.",
      "maneuver", MANEUVER_VERSION);
  Command root = line.root();
  root.Option("--server", &environment.server,
              "HOST:PORT of the server. With IP:PORT,IP:PORT or dns:///NAME:PORT predictions "
              "rotate over several servers",
              "MANEUVER_SERVER");
  root.Flag("--tls", &environment.tls, "Use TLS and trust the system's certificate authorities");
  root.Option("--tls-ca", &environment.tls_ca, "Use TLS and trust this certificate authority, PEM",
              "MANEUVER_TLS_CA");
  root.Option("--tls-certificate", &environment.tls_certificate,
              "Certificate of this client, PEM, if the server requires one",
              "MANEUVER_TLS_CERTIFICATE");
  root.Option("--tls-key", &environment.tls_key, "The certificate's private key, PEM",
              "MANEUVER_TLS_KEY");
  root.Option("--tls-server-name", &environment.tls_server_name,
              "Name in the server's certificate, if it differs from --server",
              "MANEUVER_TLS_SERVER_NAME");
  root.Option("--token-file", &environment.token_file,
              "File with the token that authenticates the caller; or set MANEUVER_TOKEN to the "
              "token itself",
              "MANEUVER_TOKEN_FILE");
  root.Choice("--output", &environment.output, {"text", "json"},
              "Tables for people, or proto3 JSON for scripts");
  root.Option("--timeout", &environment.timeout, 0.001, 1e6,
              "Most seconds for each call [depends on the call]");
  root.Flag("-v,--verbose", &environment.verbose, "Print more messages");
  root.Flag("-q,--quiet", &environment.quiet, "Print only answers and errors");
  root.Exclude("--quiet", "--verbose");
  root.Choice("--progress", &environment.progress, {"auto", "json", "none"},
              "auto: drawn on a terminal; json: a line of JSON on standard error for each step");
  for (const char* command : {"token", "store", "repair"}) line.NameElsewhere(command, "maneuverd");
  for (const char* command : {"prune", "match-actions"}) {
    line.NameElsewhere(command, "maneuver-trainer");
  }
  line.BeforeCommand([&environment] { environment.TakeOptions(); });
  AddSynthesize(root, environment);
  AddImport(root, environment);
  AddDataset(root, environment);
  AddScenario(root, environment);
  AddTrain(root, environment);
  AddEvaluate(root, environment);
  AddCrossValidate(root, environment);
  AddRecalibrate(root, environment);
  AddJob(root, environment);
  AddModel(root, environment);
  AddPredict(root, environment);
  AddClassify(root, environment);
  AddTag(root, environment);
  AddTags(root, environment);
  AddFind(root, environment);
  AddOutcomes(root, environment);
  AddLoad(root, environment);
  AddHealth(root, environment);
  AddLogLevel(root, environment);
  AddCompletion(line, root, environment);
  const int status = Run(line, arguments, environment);
  return environment.Flush() ? status : std::max<int>(status, kFailed);
}

}  // namespace maneuver::cli
