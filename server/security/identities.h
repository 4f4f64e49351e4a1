// The callers that the server knows: names, roles and credentials. Read from a file of lines
//
//   NAME  ROLE[,ROLE]  CREDENTIAL        # a line that starts with '#' is a comment
//
//   planner   predict        sha256:9f86d081884c7d65...   a bearer token, by its SHA-256
//   guest     predict        sha256:60303ae22b998861... expires=2027-01-31T00:00:00Z
//   fleet     predict,train  san:fleet.example.com        a client certificate, by a name in it
//   operator  admin          cn:Ada Lovelace              a client certificate, by its common name
//
// Several lines may have the same name, for example while a new token replaces an old one.
//
// Tokens are 256 random bits, made by NewToken and never chosen by people. No dictionary attack is
// possible, so one round of SHA-256 protects stored tokens as well as a slow, salted hash, and a
// call costs a microsecond instead of a tenth of a second.

#ifndef MANEUVER_SERVER_SECURITY_IDENTITIES_H_
#define MANEUVER_SERVER_SECURITY_IDENTITIES_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/security/roles.h"

namespace maneuver::security {

struct Identity {
  std::string name;  // [A-Za-z0-9._-], at most 63 characters
  RoleSet roles;
  std::optional<absl::Time> expires = std::nullopt;  // of a token; nothing: never

  bool HasExpired(absl::Time now) const { return expires && now >= *expires; }
};

// The content of one line of the file.
struct IdentityLine {
  enum class Kind { kToken, kAlternativeName, kCommonName };

  Identity identity;
  Kind kind = Kind::kToken;
  std::string credential;  // of a token: SHA-256 in lower-case hexadecimal
};

// Reads one line. Nothing for a comment or an empty line. INVALID_ARGUMENT says what is wrong,
// without the line's content.
absl::StatusOr<std::optional<IdentityLine>> ParseIdentityLine(std::string_view line);

// The kinds of alternative names that a line after "san:" can mean. Never e-mail names, directory
// names or others.
enum class NameKind { kDns, kUri, kAddress };
// Returns which one a text means: an address if it reads as IPv4 or IPv6, else a URI if it has a
// colon, else a DNS name. A certificate's name of another kind with the same text is not that name.
NameKind KindOf(const std::string& name);

// Immutable, hence thread-safe.
class Identities {
 public:
  // Parses the text of a file. INVALID_ARGUMENT names the invalid line by its number, without its
  // content.
  static absl::StatusOr<Identities> Parse(std::string_view text);

  // Returns the identity of a token, or nullptr. The caller checks whether it has expired. Takes
  // the same time for every token, known or not.
  const Identity* FindToken(std::string_view token) const;
  // Returns the identity of a certificate, or nullptr: the first line that has one of its names.
  //   alternative_names: the certificate's DNS names, URIs and addresses, as text; of each those
  //     that KindOf says are of their kind
  //   common_name: empty for none.
  const Identity* FindCertificate(const std::vector<std::string>& alternative_names,
                                  std::string_view common_name) const;

  // Returns whether any token expired after `after` and no later than `now`.
  bool AnyExpired(absl::Time after, absl::Time now) const;

  // Returns all lines in the order of the file.
  const std::vector<IdentityLine>& lines() const { return lines_; }

 private:
  std::vector<IdentityLine> lines_;
};

// Returns a new token: "mvr_" and 64 hexadecimal digits, 256 bits from the operating system.
std::string NewToken();

// Returns the line of a token for the file. INVALID_ARGUMENT if the name is not valid.
//   expires: to the second; nothing: never.
absl::StatusOr<std::string> TokenLine(std::string_view name, const RoleSet& roles,
                                      std::string_view token,
                                      std::optional<absl::Time> expires = std::nullopt);

// Returns a time in the form "2027-01-31T00:00:00Z".
std::string FormatExpiry(absl::Time expires);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_IDENTITIES_H_
