#include "server/maneuverd/token_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "server/jobs/trainer/unknown_words.h"
#include "server/security/identities.h"
#include "server/security/secret_file.h"

namespace maneuver {
namespace {

using security::IdentityLine;

constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
constexpr size_t kIdDigits = 12;      // of a token's SHA-256, as `list` shows them
constexpr size_t kLeastIdDigits = 8;  // that `revoke` takes

int Fail(int status, const std::string& command, const absl::Status& error) {
  std::cerr << "maneuverd token " << command << ": " << error.message() << "\n";
  return status;
}

absl::Status InFile(const std::filesystem::path& file, const absl::Status& status) {
  return {status.code(), absl::StrCat(file.string(), ": ", status.message())};
}

// "90d", "12h" or "30m" from `now`, or a time such as "2027-01-31T12:00:00Z" or "2027-01-31", which
// begins in UTC. INVALID_ARGUMENT for another text, or a time that is not in the future.
absl::StatusOr<absl::Time> ParseExpiry(const std::string& text, absl::Time now) {
  absl::Time expires;
  std::string error;
  int64_t count = 0;
  const char unit = text.empty() ? '\0' : text.back();
  if ((unit == 'd' || unit == 'h' || unit == 'm') &&
      absl::SimpleAtoi(text.substr(0, text.size() - 1), &count)) {
    expires = now + count * (unit == 'd'   ? absl::Hours(24)
                             : unit == 'h' ? absl::Hours(1)
                                           : absl::Minutes(1));
  } else if (!absl::ParseTime(absl::RFC3339_full, text, &expires, &error) &&
             !absl::ParseTime("%Y-%m-%d", text, &expires, &error)) {
    return absl::InvalidArgumentError(
        "--expires: give a span such as 90d, 12h or 30m, or a time such as 2027-01-31 or "
        "2027-01-31T12:00:00Z");
  }
  if (expires <= now || expires == absl::InfiniteFuture()) {
    return absl::InvalidArgumentError(absl::StrCat("--expires: ", text, " is not in the future"));
  }
  return expires;
}

int Create(const std::string& name, const std::string& roles_text, const std::string& expires_text,
           const std::filesystem::path& file, absl::Time now) {
  const auto roles = security::RoleSet::Parse(roles_text);
  if (!roles.ok()) return Fail(kWrongUsage, "create", roles.status());
  std::optional<absl::Time> expires;
  if (!expires_text.empty()) {
    const auto parsed = ParseExpiry(expires_text, now);
    if (!parsed.ok()) return Fail(kWrongUsage, "create", parsed.status());
    expires = *parsed;
  }
  const std::string token = security::NewToken();
  const auto line = security::TokenLine(name, *roles, token, expires);
  if (!line.ok()) return Fail(kWrongUsage, "create", line.status());
  if (const auto status = security::AppendLine(file, *line); !status.ok()) {
    return Fail(kFailed, "create", InFile(file, status));
  }
  std::cerr << "The token of " << name
            << (expires ? ", which expires at " + security::FormatExpiry(*expires) : "")
            << ", shown this once; " << file.string() << " keeps its SHA-256 alone:\n";
  if (!(std::cout << token << std::endl)) {
    return Fail(kFailed, "create",
                absl::UnavailableError("cannot write to standard output, so the token is lost: "
                                       "remove it with maneuverd token revoke"));
  }
  return 0;
}

std::string ExpiryText(const IdentityLine& line, absl::Time now) {
  if (!line.identity.expires) return "never";
  const std::string time = security::FormatExpiry(*line.identity.expires);
  return line.identity.HasExpired(now) ? "expired " + time : time;
}

std::string CredentialText(const IdentityLine& line) {
  switch (line.kind) {
    case IdentityLine::Kind::kToken:
      return "token " + line.credential.substr(0, kIdDigits);
    case IdentityLine::Kind::kAlternativeName:
      return "san:" + line.credential;
    case IdentityLine::Kind::kCommonName:
      return "cn:" + line.credential;
  }
  return "";
}

int List(const std::filesystem::path& file, absl::Time now) {
  const auto text = security::ReadSecretFile(file);
  if (!text.ok()) return Fail(kFailed, "list", InFile(file, text.status()));
  const auto identities = security::Identities::Parse(*text);
  if (!identities.ok()) return Fail(kFailed, "list", InFile(file, identities.status()));
  std::vector<std::array<std::string, 4>> rows = {{"NAME", "ROLES", "CREDENTIAL", "EXPIRES"}};
  for (const IdentityLine& line : identities->lines()) {
    rows.push_back({line.identity.name, line.identity.roles.ToString(), CredentialText(line),
                    ExpiryText(line, now)});
  }
  std::array<size_t, 3> widths{};
  for (const auto& row : rows) {
    for (size_t i = 0; i < widths.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  for (const auto& row : rows) {
    for (size_t i = 0; i < widths.size(); ++i) {
      std::cout << row[i] << std::string(widths[i] - row[i].size() + 2, ' ');
    }
    std::cout << row.back() << "\n";
  }
  if (!std::cout.flush()) {
    return Fail(kFailed, "list", absl::UnavailableError("cannot write to standard output"));
  }
  return 0;
}

// Which tokens `revoke` takes back: one of these.
struct RevokedTokens {
  std::string name;
  std::string id;
  bool expired = false;

  bool Contain(const IdentityLine& line, absl::Time now) const {
    if (line.kind != IdentityLine::Kind::kToken) return false;
    if (!name.empty()) return line.identity.name == name;
    if (!id.empty()) return line.credential.starts_with(id);
    return line.identity.HasExpired(now);
  }
};

int Revoke(const RevokedTokens& revoked, const std::filesystem::path& file, absl::Time now) {
  if (!revoked.id.empty() && revoked.id.size() < kLeastIdDigits) {
    return Fail(kWrongUsage, "revoke",
                absl::InvalidArgumentError(
                    absl::StrCat("--id: give at least ", kLeastIdDigits,
                                 " digits of the token's id, as \"token list\" shows it")));
  }
  std::vector<IdentityLine> removed;
  int certificates = 0;  // of the same name; they stay
  const auto status =
      security::EditSecretFile(file, [&](const std::string& text) -> absl::StatusOr<std::string> {
        // A file that the server does not read must not look as if a token had been taken back.
        if (const auto all = security::Identities::Parse(text); !all.ok()) return all.status();
        std::vector<std::string> kept;
        for (const absl::string_view row : absl::StrSplit(text, '\n')) {
          const auto line = *security::ParseIdentityLine(std::string(row));
          if (line && revoked.Contain(*line, now)) {
            removed.push_back(*line);
            continue;
          }
          if (line && line->identity.name == revoked.name) ++certificates;
          kept.emplace_back(row);
        }
        if (removed.empty()) return absl::NotFoundError("no such token");
        if (!revoked.id.empty() && removed.size() > 1) {
          return absl::InvalidArgumentError("several tokens have this id; give more of its digits");
        }
        return absl::StrJoin(kept, "\n");
      });
  if (!status.ok() && !(revoked.expired && absl::IsNotFound(status))) {
    return Fail(kFailed, "revoke", InFile(file, status));
  }
  for (const IdentityLine& line : removed) {
    std::cout << "Revoked " << CredentialText(line) << " of " << line.identity.name << " ("
              << line.identity.roles.ToString() << ").\n";
  }
  if (removed.empty()) std::cout << "No token has expired.\n";
  std::cout << std::flush;
  if (certificates > 0) {
    std::cerr << revoked.name << " may still call by certificate: " << certificates
              << (certificates == 1 ? " line" : " lines") << " of " << file.string()
              << " say so. Delete what is not meant.\n";
  }
  return 0;
}

}  // namespace

int RunTokenCommand(int argc, const char* const* argv, absl::Time now) {
  std::string name;
  std::string roles;
  std::string expires;
  std::filesystem::path file;
  RevokedTokens revoked;
  CLI::App app("maneuverd token: who may call the server");
  app.name("maneuverd token");
  app.require_subcommand(1);
  const auto add_command = [&](const std::string& command, const std::string& help) {
    CLI::App* added = app.add_subcommand(command, help);
    added->add_option("--tokens", file, "Tokens file, as for maneuverd --tokens")->required();
    return added;
  };
  CLI::App* create = add_command(
      "create",
      "Prints a new token on standard output and adds its line to FILE; a server that reads FILE "
      "knows it within a second");
  create->add_option("--name", name, "Name of the caller that the token identifies")->required();
  create->add_option("--roles", roles, "Any of predict, train and admin, separated by commas")
      ->required();
  create->add_option("--expires", expires,
                     "When the token expires: after 90d, 12h or 30m, or at 2027-01-31 or "
                     "2027-01-31T12:00:00Z [never]");
  CLI::App* list = add_command("list", "Shows who may call, by which credential, and until when");
  CLI::App* revoke = add_command(
      "revoke", "Removes tokens from FILE; a server that reads FILE refuses them within a second");
  auto* which = revoke->add_option_group("which", "Which tokens");
  which->require_option(1);
  which->add_option("--name", revoked.name, "All tokens of this name");
  which->add_option("--id", revoked.id, "The token with this id, as \"token list\" shows it");
  which->add_flag("--expired", revoked.expired, "All tokens that have expired");
  app.failure_message([](const CLI::App* failed, const CLI::Error& error) {
    const std::string unknown = UnknownWord(*failed);
    return unknown.empty() ? CLI::FailureMessage::simple(failed, error) : unknown + "\n";
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongUsage;
  }
  if (list->parsed()) return List(file, now);
  if (revoke->parsed()) return Revoke(revoked, file, now);
  return Create(name, roles, expires, file, now);
}

}  // namespace maneuver
