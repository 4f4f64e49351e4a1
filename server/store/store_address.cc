#include "server/store/store_address.h"

#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"

namespace maneuver::store {
namespace {

// libpq also decodes the names of parameters, so a name with an escape could be any.
bool HoldsPassword(std::string_view after_scheme) {
  const std::string_view authority = after_scheme.substr(0, after_scheme.find('/'));
  const size_t at = authority.rfind('@');
  if (at != std::string_view::npos && authority.substr(0, at).find(':') != std::string_view::npos) {
    return true;
  }
  const size_t query = after_scheme.find('?');
  // To libpq, a '/' that is not escaped ends the authority, also within a password: it would then
  // repeat the password's start as a port that is none.
  const std::string_view before_query = after_scheme.substr(0, query);
  const size_t first_at = before_query.find('@');
  if (first_at != std::string_view::npos &&
      before_query.substr(0, first_at).find(':') != std::string_view::npos) {
    return true;
  }
  if (query == std::string_view::npos) return false;
  const std::string_view text = after_scheme.substr(query + 1);
  for (const absl::string_view pair :
       absl::StrSplit(absl::string_view(text.data(), text.size()), '&')) {
    const absl::string_view name = pair.substr(0, pair.find('='));
    if (absl::EndsWithIgnoreCase(name, "password") || absl::StrContains(name, "%")) return true;
  }
  return false;
}

}  // namespace

absl::Status CheckStoreAddress(const std::string& address) {
  if (address.empty()) return absl::OkStatus();
  const size_t scheme = address.find("://");
  if (scheme == std::string::npos ||
      (address.substr(0, scheme) != "postgresql" && address.substr(0, scheme) != "postgres")) {
    return absl::InvalidArgumentError(
        "expected a URI such as postgresql://maneuver@db.example/maneuver?sslmode=verify-full; "
        "without --store jobs and aliases are in the data folder");
  }
  if (HoldsPassword(std::string_view(address).substr(scheme + 3))) {
    return absl::InvalidArgumentError(
        "the URI holds a password, which others could read; put it into a password file "
        "(?passfile=FILE) or a service file (?service=NAME)");
  }
  return absl::OkStatus();
}

}  // namespace maneuver::store
