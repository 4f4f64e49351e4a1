// The environment of a command: its streams, the global options, and the server that it calls.

#ifndef MANEUVER_CLIENT_CLI_ENVIRONMENT_H_
#define MANEUVER_CLIENT_CLI_ENVIRONMENT_H_

#include <google/protobuf/message.h>

#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "client/cli/progress_line.h"
#include "client/client.h"

namespace maneuver::cli {

// Not thread-safe.
class Environment {
 public:
  Environment(std::istream& input, std::ostream& answers, std::ostream& messages);

  // Only answers go to `out`. Messages go to `err`, and failures to `errors`, which --quiet does
  // not silence.
  std::istream& in;
  std::ostream& out;
  std::ostream& err;
  std::ostream& errors;
  bool color = false;        // out is a terminal that wants colour
  bool interactive = false;  // err is a terminal: progress may be drawn in place

  // Global options.
  std::string server = "127.0.0.1:8470";
  bool tls = false;    // also true if one of the next four options is given
  std::string tls_ca;  // PEM files
  std::string tls_certificate;
  std::string tls_key;
  std::string tls_server_name;
  std::string token_file;
  std::string token;  // from the environment: other users can read command lines
  std::string output = "text";
  std::optional<double> timeout;  // seconds
  // The option that limits the time of the next calls. When an answer comes too late, the message
  // advises to raise it.
  std::string time_limit = "--timeout SECONDS";
  bool verbose = false;
  bool quiet = false;
  std::string progress = "auto";  // or json, none

  // Applies the options, such as --quiet. Call once they are set.
  void TakeOptions();
  ProgressForm progress_form() const;

  bool json() const { return output == "json"; }

  // Returns the options above for another connection to the server.
  client::ClientOptions client_options();
  // Returns the server, connecting on first use. If the options above make that impossible, says
  // why and ends the program.
  client::Client& server_client();
  // Returns the options of a call, with the limit of --timeout if that is given.
  client::CallOptions call_options() const;

  // Prints `message` as proto3 JSON, including fields with default values.
  void PrintJson(const google::protobuf::Message& message);

  // Writes to `errors` why a command failed, as Describe says it; returns kFailed. With --output
  // json it writes one line of JSON: {"error": {"code", "reason", "message"}}.
  int Fail(const absl::Status& status);
  // Does the same for a call to the server that failed. Also says what to do, as Explain does.
  int FailCall(const absl::Status& status);
  // Does the same as Fail for an error about a local file or folder. The message begins with
  // `path`.
  int FailAt(const std::string& path, const absl::Status& status);
  // Writes an error in the form of Fail.
  //   reason: as in the error's details; empty: none
  void PrintError(const std::string& code, const std::string& reason, const std::string& message);
  // Reports an invalid command line in the same form as Fail. Returns kUsage.
  int Refuse(const std::string& message);
  // Returns why a call to the server failed, and what to do; then the details, as Describe does.
  std::string Explain(const absl::Status& status) const;
  // Returns an error of this machine, or within an answer, as that of a job: the message, when to
  // try again, then each wrong field on its own line.
  static std::string Describe(const absl::Status& status);
  // Returns whether all answers could be printed and written to `out`. If not, says so on `errors`. A
  // pipe that its reader has closed, as head does, is no failure.
  bool Flush();

 private:
  int Fail(const absl::Status& status, const std::string& message);

  std::ostream messages_;  // what `err` refers to; discards all output with --quiet

  // How calls are secured; none for plain text.
  std::optional<client::TlsOptions> tls_options() const;
  bool cannot_print_ = false;  // an answer that JSON has no form for

  std::unique_ptr<client::Client> client_;
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ENVIRONMENT_H_
