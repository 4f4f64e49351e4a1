#include "client/cli/environment.h"

#include <grpc/support/log.h>

#include <cerrno>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <ostream>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/cli/answer_json.h"
#include "client/cli/command.h"
#include "client/cli/text_format.h"
#include "client/cli/tls_failure.h"
#include "client/error_details.h"

namespace maneuver::cli {
namespace {

void DropLogLine(gpr_log_func_args*) {}

// Messages of the server name its methods; people at a command line know its commands.
std::string WithCommands(absl::string_view message) {
  return absl::StrReplaceAll(message, {{"ListModelVersions names", "maneuver model list shows"},
                                       {"with SetModelAlias", "with maneuver model promote"},
                                       {"with DeleteModelAlias", "with maneuver model unalias"},
                                       {"name one of them in `model`", "name one with --model"},
                                       {"required_action_names: ", "--require-name: "},
                                       {"see its actions with GetActionSet",
                                        "maneuver model actions shows those that it has"},
                                       {"register it with RegisterMap and repeat the request",
                                        "give the scene its map_features in place of map_id"}});
}

std::string MessageOf(const absl::Status& status) {
  const std::string text = WithCommands(status.message());
  return text.empty() ? absl::StatusCodeToString(status.code()) : text;
}

// Adds when to try again, the other missing names, and each wrong field on a line of its own.
std::string WithDetails(std::string text, const client::ErrorDetails& details) {
  if (details.retry_delay) {
    absl::StrAppend(&text, "; try again in ", absl::FormatDuration(*details.retry_delay));
  }
  // The message has the first.
  for (size_t i = 1; i < details.missing_action_names.size(); ++i) {
    absl::StrAppend(&text, "\n  nor \"", details.missing_action_names[i], "\"");
  }
  for (const client::FieldViolation& violation : details.field_violations) {
    const std::string line = absl::StrCat(violation.field, ": ", violation.description);
    // A message may be its only violation.
    if (!absl::StrContains(text, line)) absl::StrAppend(&text, "\n  ", line);
  }
  return text;
}

}  // namespace

Environment::Environment(std::istream& input, std::ostream& answers, std::ostream& messages)
    : in(input), out(answers), err(messages_), errors(messages), messages_(messages.rdbuf()) {
  messages_.copyfmt(messages);  // when it is flushed, above all
}

void Environment::TakeOptions() {
  if (quiet) messages_.rdbuf(nullptr);
}

ProgressForm Environment::progress_form() const {
  if (progress == "json") return ProgressForm::kJson;
  return progress == "auto" && interactive && !quiet ? ProgressForm::kLine : ProgressForm::kNone;
}

std::optional<client::TlsOptions> Environment::tls_options() const {
  if (!tls && tls_ca.empty() && tls_certificate.empty() && tls_key.empty() &&
      tls_server_name.empty()) {
    return std::nullopt;
  }
  return client::TlsOptions{tls_ca, tls_certificate, tls_key, tls_server_name};
}

client::ClientOptions Environment::client_options() {
  client::ClientOptions options;
  options.address = server;
  options.user_agent = "maneuver/" MANEUVER_VERSION;
  if (verbose) {
    options.on_retry = [this](const absl::Status& failure, absl::Duration wait) {
      err << Printable(std::string(failure.message())) << "; trying again in "
          << absl::FormatDuration(wait) << "\n";
    };
  }
  options.tls = tls_options();
  options.token_file = token_file;
  if (token_file.empty()) options.token = token;
  return options;
}

client::Client& Environment::server_client() {
  if (client_ == nullptr) {
    // What gRPC logs by itself is for those who debug; the error says what has to be known.
    gpr_set_log_function(verbose ? nullptr : DropLogLine);
    auto connected = client::Client::Connect(client_options());
    if (!connected.ok()) std::exit(Refuse(std::string(connected.status().message())));
    client_ = *std::move(connected);
  }
  return *client_;
}

client::CallOptions Environment::call_options() const {
  client::CallOptions call;
  if (timeout) call.timeout = absl::Seconds(*timeout);
  return call;
}

void Environment::PrintJson(const google::protobuf::Message& message) {
  const absl::StatusOr<std::string> text = ToAnswerJson(message);
  if (text.ok()) {
    out << *text;
  } else {
    (void)Fail(text.status());
    cannot_print_ = true;
  }
}

int Environment::Fail(const absl::Status& status) { return Fail(status, Describe(status)); }

int Environment::FailCall(const absl::Status& status) { return Fail(status, Explain(status)); }

int Environment::Fail(const absl::Status& status, const std::string& message) {
  PrintError(absl::StatusCodeToString(status.code()), client::ErrorDetailsOf(status).reason,
             message);
  return kFailed;
}

int Environment::FailAt(const std::string& path, const absl::Status& status) {
  PrintError(absl::StatusCodeToString(status.code()), "",
             absl::StrCat(path, ": ", status.message()));
  return kFailed;
}

int Environment::Refuse(const std::string& message) {
  PrintError(absl::StatusCodeToString(absl::StatusCode::kInvalidArgument), "", message);
  return kUsage;
}

void Environment::PrintError(const std::string& code, const std::string& reason,
                             const std::string& message) {
  if (!json()) {
    errors << "maneuver: " << PrintableLines(message) << "\n";
    return;
  }
  nlohmann::ordered_json line;
  nlohmann::ordered_json& error = line["error"];
  error["code"] = code;
  error["message"] = message;
  if (!reason.empty()) error["reason"] = reason;
  // A path, or what a server says, may be no UTF-8.
  errors << line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << "\n";
}

bool Environment::Flush() {
  const bool has_failed = !out;
  if (cannot_print_) return false;  // PrintJson has said so
  out.clear();
  errno = 0;
  // Of a text longer than the buffer nothing may be left to write: a line break fails for its reason.
  if (has_failed) out.put('\n');
  if (out.flush() && !has_failed) return true;
  const int error = errno;
  if (error == EPIPE) return true;
  PrintError(absl::StatusCodeToString(absl::StatusCode::kFailedPrecondition), "",
             "cannot write to standard output" +
                 (error != 0 ? ": " + std::generic_category().message(error) : ""));
  return false;
}

std::string Environment::Explain(const absl::Status& status) const {
  const client::ErrorDetails details = client::ErrorDetailsOf(status);
  std::string text = MessageOf(status);
  const std::string tls_failure =
      absl::IsUnavailable(status) ? ExplainTlsFailure(text, server, tls_options()) : "";
  if (!tls_failure.empty()) {
    text = tls_failure;
  } else if (absl::IsUnavailable(status) && details.reason.empty()) {
    text = absl::StrCat("no server answers at ", server,
                        "; start one with maneuverd --data-dir DIR, name it with --server, or add "
                        "--tls or --tls-ca if it serves over TLS (",
                        text, ")");
  } else if (absl::IsDeadlineExceeded(status) && details.reason.empty()) {
    text = absl::StrCat("the server at ", server, " did not answer in time; allow more with ",
                        time_limit, " (", text, ")");
  } else if (absl::IsUnimplemented(status)) {
    text = absl::StrCat("the server at ", server,
                        " does not know this call; it may be older than this command (", text, ")");
  }
  return WithDetails(std::move(text), details);
}

std::string Environment::Describe(const absl::Status& status) {
  return WithDetails(MessageOf(status), client::ErrorDetailsOf(status));
}

}  // namespace maneuver::cli
