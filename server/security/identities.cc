#include "server/security/identities.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <openssl/crypto.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "model/files/digest.h"

namespace maneuver::security {
namespace {

constexpr std::string_view kTokenMark = "sha256:";
constexpr std::string_view kAlternativeNameMark = "san:";
constexpr std::string_view kCommonNameMark = "cn:";
constexpr std::string_view kExpiresMark = "expires=";
constexpr std::string_view kSpace = " \t\r";
constexpr size_t kDigestDigits = 64;
constexpr size_t kMaxNameLength = 63;

bool IsName(std::string_view name) {
  return !name.empty() && name.size() <= kMaxNameLength && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  });
}

// Returns an IPv4 or IPv6 address as gRPC writes those of certificates; nothing for other texts.
std::optional<std::string> AsAddress(const std::string& text) {
  unsigned char address[sizeof(in6_addr)];
  char written[INET6_ADDRSTRLEN];
  for (const int family : {AF_INET, AF_INET6}) {
    if (inet_pton(family, text.c_str(), address) != 1) continue;
    return inet_ntop(family, address, written, sizeof written);
  }
  return std::nullopt;
}

std::string_view Trim(std::string_view text) {
  const size_t begin = text.find_first_not_of(kSpace);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kSpace) - begin + 1);
}

// Removes the first word from `text`, trims the rest and returns the word.
std::string_view TakeWord(std::string_view& text) {
  const std::string_view word = text.substr(0, text.find_first_of(kSpace));
  text = Trim(text.substr(word.size()));
  return word;
}

constexpr char kNameRule[] = "a name has at most 63 characters: letters, digits, '.', '_' and '-'";

// Reads "<64 digits>" or "<64 digits> expires=TIME". False if it is neither.
bool ParseToken(std::string_view text, IdentityLine& line) {
  const std::string_view digest = TakeWord(text);
  if (!files::IsSha256Hex(digest)) return false;
  line.kind = IdentityLine::Kind::kToken;
  line.credential = std::string(digest);
  if (text.empty()) return true;
  if (!text.starts_with(kExpiresMark)) return false;
  absl::Time expires;
  std::string error;
  if (!absl::ParseTime(absl::RFC3339_full, std::string(text.substr(kExpiresMark.size())), &expires,
                       &error)) {
    return false;
  }
  line.identity.expires = expires;
  return true;
}

absl::StatusOr<IdentityLine> ParseWords(std::string_view line) {
  IdentityLine entry;
  const std::string_view name = TakeWord(line);
  if (!IsName(name)) return absl::InvalidArgumentError(kNameRule);
  entry.identity.name = std::string(name);
  const auto roles = RoleSet::Parse(TakeWord(line));
  if (!roles.ok()) return roles.status();
  entry.identity.roles = *roles;
  bool known = false;
  if (line.starts_with(kTokenMark)) {
    known = ParseToken(line.substr(kTokenMark.size()), entry);
  } else if (line.starts_with(kAlternativeNameMark)) {
    entry.kind = IdentityLine::Kind::kAlternativeName;
    entry.credential = std::string(line.substr(kAlternativeNameMark.size()));
    entry.credential = AsAddress(entry.credential).value_or(entry.credential);
    known = !entry.credential.empty();
  } else if (line.starts_with(kCommonNameMark)) {
    entry.kind = IdentityLine::Kind::kCommonName;
    entry.credential = std::string(line.substr(kCommonNameMark.size()));
    known = !entry.credential.empty();
  }
  if (!known) {
    return absl::InvalidArgumentError(
        "expected NAME ROLES CREDENTIAL, the credential as sha256:<64 hexadecimal digits>, which "
        "expires=2027-01-31T00:00:00Z may follow, san:<name in a certificate> or cn:<common name>");
  }
  return entry;
}

}  // namespace

NameKind KindOf(const std::string& name) {
  if (AsAddress(name)) return NameKind::kAddress;
  return name.find(':') == std::string::npos ? NameKind::kDns : NameKind::kUri;
}

absl::StatusOr<std::optional<IdentityLine>> ParseIdentityLine(std::string_view line) {
  const std::string_view text = Trim(line);
  if (text.empty() || text.front() == '#') return std::optional<IdentityLine>();
  auto entry = ParseWords(text);
  if (!entry.ok()) return entry.status();
  return std::optional<IdentityLine>(*std::move(entry));
}

absl::StatusOr<Identities> Identities::Parse(std::string_view text) {
  Identities identities;
  for (int number = 1; !text.empty(); ++number) {
    const size_t end = text.find('\n');
    auto entry = ParseIdentityLine(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (!entry.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("line ", number, ": ", entry.status().message()));
    }
    if (*entry) identities.lines_.push_back(**std::move(entry));
  }
  return identities;
}

const Identity* Identities::FindToken(std::string_view token) const {
  const std::string digest = files::Sha256Hex(token);
  const Identity* found = nullptr;
  // Every entry is looked at, to its last byte, so that time tells nothing.
  for (const IdentityLine& entry : lines_) {
    if (entry.kind != IdentityLine::Kind::kToken) continue;
    const bool equal = CRYPTO_memcmp(digest.data(), entry.credential.data(), kDigestDigits) == 0;
    if (equal && found == nullptr) found = &entry.identity;
  }
  return found;
}

const Identity* Identities::FindCertificate(const std::vector<std::string>& alternative_names,
                                            std::string_view common_name) const {
  for (const IdentityLine& entry : lines_) {
    const bool found =
        (entry.kind == IdentityLine::Kind::kAlternativeName &&
         std::ranges::find(alternative_names, entry.credential) != alternative_names.end()) ||
        (entry.kind == IdentityLine::Kind::kCommonName && entry.credential == common_name);
    if (found) return &entry.identity;
  }
  return nullptr;
}

bool Identities::AnyExpired(absl::Time after, absl::Time now) const {
  return std::ranges::any_of(lines_, [&](const IdentityLine& line) {
    return line.identity.HasExpired(now) && !line.identity.HasExpired(after);
  });
}

std::string NewToken() {
  std::array<unsigned char, 32> bits{};
  // getrandom returns up to 256 bytes in one piece, or fails.
  if (getrandom(bits.data(), bits.size(), 0) != static_cast<ssize_t>(bits.size())) std::abort();
  std::string token = "mvr_";
  for (const unsigned char byte : bits) {
    absl::StrAppend(&token, absl::Hex(byte, absl::kZeroPad2));
  }
  return token;
}

absl::StatusOr<std::string> TokenLine(std::string_view name, const RoleSet& roles,
                                      std::string_view token, std::optional<absl::Time> expires) {
  if (!IsName(name)) return absl::InvalidArgumentError(kNameRule);
  std::string line = absl::StrCat(std::string(name), " ", roles.ToString(), " ",
                                  std::string(kTokenMark), files::Sha256Hex(token));
  if (expires) absl::StrAppend(&line, " ", std::string(kExpiresMark), FormatExpiry(*expires));
  return line + "\n";
}

std::string FormatExpiry(absl::Time expires) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", expires, absl::UTCTimeZone());
}

}  // namespace maneuver::security
