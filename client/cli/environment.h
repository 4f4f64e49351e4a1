// What every command works in: its streams, the global options, and the server that it talks to.

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

  // Answers go to out and to nothing else, messages to err, and what went wrong to errors, which
  // --quiet does not silence.
  std::istream& in;
  std::ostream& out;
  std::ostream& err;
  std::ostream& errors;
  bool color = false;        // out is a terminal that wants colour
  bool interactive = false;  // err is a terminal: progress may be drawn in place

  // Global options.
  std::string server = "127.0.0.1:8470";
  bool tls = false;    // also if one of the four that follow is given
  std::string tls_ca;  // PEM files
  std::string tls_certificate;
  std::string tls_key;
  std::string tls_server_name;
  std::string token_file;
  std::string token;  // from the environment: what is on a command line, others can read
  std::string output = "text";
  std::optional<double> timeout;  // seconds
  // The option that limits the time of the calls that follow: what a late answer advises to raise.
  std::string time_limit = "--timeout SECONDS";
  bool verbose = false;
  bool quiet = false;
  std::string progress = "auto";

  // Call once the options are set: silences err, if they say so.
  void TakeOptions();
  ProgressForm progress_form() const;

  bool json() const { return output == "json"; }

  // The options above, for another connection to that server.
  client::ClientOptions client_options();
  // The server, connected to on first use. Says why and ends the program if the options above make
  // that impossible.
  client::Client& server_client();
  // --timeout, as each call takes it.
  client::CallOptions call_options() const;

  // Prints `message` as proto3 JSON, all fields of an answer included.
  void PrintJson(const google::protobuf::Message& message);

  // Says on err why a command failed, in a sentence that says what to do; returns kFailed. With
  // --output json err gets one line of JSON: {"error": {"code", "reason", "message"}}.
  int Fail(const absl::Status& status);
  // The same for a file or folder of this machine, which is named first.
  int FailAt(const std::string& path, const absl::Status& status);
  // The same for a command line that makes no sense; returns kUsage.
  int Refuse(const std::string& message);
  // What Fail says: the message, what to do about it, then each wrong field on a line of its own.
  std::string Explain(const absl::Status& status) const;
  // Whether all answers could be written to out. If not, says so on err; a reader who has gone,
  // such as head, is none to be told.
  bool Flush();

 private:
  std::ostream messages_;  // err: as the stream that it was made from, or silent

  void PrintError(const std::string& code, const std::string& reason, const std::string& message);

  std::unique_ptr<client::Client> client_;
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_ENVIRONMENT_H_
