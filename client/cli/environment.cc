#include "client/cli/environment.h"

#include <google/protobuf/util/json_util.h>

#include <cstdlib>
#include <ostream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/command.h"
#include "client/error_details.h"

namespace maneuver::cli {

Environment::Environment(std::istream& input, std::ostream& answers, std::ostream& messages)
    : in(input), out(answers), err(messages) {}

client::ClientOptions Environment::client_options() {
  client::ClientOptions options;
  options.address = server;
  options.user_agent = "maneuver/" MANEUVER_VERSION;
  if (verbose) {
    options.on_retry = [this](const absl::Status& failure, absl::Duration wait) {
      err << failure.message() << "; trying again in " << absl::FormatDuration(wait) << "\n";
    };
  }
  if (tls || !tls_ca.empty() || !tls_certificate.empty() || !tls_key.empty() ||
      !tls_server_name.empty()) {
    options.tls = client::TlsOptions{tls_ca, tls_certificate, tls_key, tls_server_name};
  }
  options.token_file = token_file;
  if (token_file.empty()) options.token = token;
  return options;
}

client::Client& Environment::server_client() {
  if (client_ == nullptr) {
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
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  std::string text;
  // Fails only for an Any of a type that is not linked in; then what there is gets printed.
  (void)google::protobuf::util::MessageToJsonString(message, &text, options);
  out << text;
}

int Environment::Fail(const absl::Status& status) {
  err << "maneuver: " << Explain(status, server) << "\n";
  return kFailed;
}

int Environment::Refuse(const std::string& message) {
  err << "maneuver: " << message << "\n";
  return kUsage;
}

std::string Explain(const absl::Status& status, const std::string& server) {
  const client::ErrorDetails details = client::ErrorDetailsOf(status);
  std::string text(status.message());
  if (text.empty()) text = absl::StatusCodeToString(status.code());
  if (absl::IsUnavailable(status) && details.reason.empty()) {
    text = absl::StrCat("no server answers at ", server,
                        "; start one with maneuverd --data-dir DIR or name it with --server; one "
                        "that serves over TLS needs --tls or --tls-ca (",
                        text, ")");
  } else if (absl::IsDeadlineExceeded(status)) {
    text = absl::StrCat("the server at ", server,
                        " did not answer in time; allow more with --timeout SECONDS (", text, ")");
  } else if (absl::IsUnimplemented(status)) {
    text = absl::StrCat("the server at ", server,
                        " does not know this call; it may be older than this command (", text, ")");
  }
  if (details.retry_delay) {
    absl::StrAppend(&text, "; try again in ", absl::FormatDuration(*details.retry_delay));
  }
  for (const client::FieldViolation& violation : details.field_violations) {
    const std::string line = absl::StrCat(violation.field, ": ", violation.description);
    // A message may be its only violation.
    if (!absl::StrContains(text, line)) absl::StrAppend(&text, "\n  ", line);
  }
  return text;
}

}  // namespace maneuver::cli
