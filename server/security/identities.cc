#include "server/security/identities.h"

#include <openssl/crypto.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "model/files/digest.h"

namespace maneuver::security {
namespace {

constexpr std::string_view kTokenMark = "sha256:";
constexpr std::string_view kAlternativeNameMark = "san:";
constexpr std::string_view kCommonNameMark = "cn:";
constexpr std::string_view kSpace = " \t\r";
constexpr size_t kDigestDigits = 64;
constexpr size_t kMaxNameLength = 63;

bool IsName(std::string_view name) {
  return !name.empty() && name.size() <= kMaxNameLength && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  });
}

bool IsDigest(std::string_view text) {
  return text.size() == kDigestDigits && std::ranges::all_of(text, [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
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

constexpr char kNameRule[] = "a name has letters, digits, '.', '_' and '-', at most 63 of them";

}  // namespace

absl::StatusOr<Identities::Entry> Identities::ParseLine(std::string_view line) {
  Entry entry;
  const std::string_view name = TakeWord(line);
  if (!IsName(name)) return absl::InvalidArgumentError(kNameRule);
  entry.identity.name = std::string(name);
  const auto roles = RoleSet::Parse(TakeWord(line));
  if (!roles.ok()) return roles.status();
  entry.identity.roles = *roles;
  if (line.starts_with(kTokenMark) && IsDigest(line.substr(kTokenMark.size()))) {
    entry.kind = Kind::kToken;
    entry.credential = std::string(line.substr(kTokenMark.size()));
  } else if (line.starts_with(kAlternativeNameMark)) {
    entry.kind = Kind::kAlternativeName;
    entry.credential = std::string(line.substr(kAlternativeNameMark.size()));
  } else if (line.starts_with(kCommonNameMark)) {
    entry.kind = Kind::kCommonName;
    entry.credential = std::string(line.substr(kCommonNameMark.size()));
  }
  if (entry.credential.empty()) {
    return absl::InvalidArgumentError(
        "expected NAME ROLES CREDENTIAL, the credential as sha256:<64 hexadecimal digits>, "
        "san:<name in a certificate> or cn:<common name>");
  }
  return entry;
}

absl::StatusOr<Identities> Identities::Parse(std::string_view text) {
  Identities identities;
  for (int number = 1; !text.empty(); ++number) {
    const size_t end = text.find('\n');
    const std::string_view line = Trim(text.substr(0, end));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.empty() || line.front() == '#') continue;
    auto entry = ParseLine(line);
    if (!entry.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("line ", number, ": ", entry.status().message()));
    }
    identities.entries_.push_back(*std::move(entry));
  }
  return identities;
}

const Identity* Identities::FindToken(std::string_view token) const {
  const std::string digest = files::Sha256Hex(token);
  const Identity* found = nullptr;
  // Compares every entry to its last byte, so that the time reveals nothing.
  for (const Entry& entry : entries_) {
    if (entry.kind != Kind::kToken) continue;
    const bool equal = CRYPTO_memcmp(digest.data(), entry.credential.data(), kDigestDigits) == 0;
    if (equal && found == nullptr) found = &entry.identity;
  }
  return found;
}

const Identity* Identities::FindCertificate(const std::vector<std::string>& alternative_names,
                                            std::string_view common_name) const {
  for (const Entry& entry : entries_) {
    const bool found =
        (entry.kind == Kind::kAlternativeName &&
         std::ranges::find(alternative_names, entry.credential) != alternative_names.end()) ||
        (entry.kind == Kind::kCommonName && entry.credential == common_name);
    if (found) return &entry.identity;
  }
  return nullptr;
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
                                      std::string_view token) {
  if (!IsName(name)) return absl::InvalidArgumentError(kNameRule);
  return absl::StrCat(std::string(name), " ", roles.ToString(), " ", std::string(kTokenMark),
                      files::Sha256Hex(token), "\n");
}

}  // namespace maneuver::security
