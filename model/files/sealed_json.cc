#include "model/files/sealed_json.h"

#include <algorithm>

#include "model/files/digest.h"

namespace maneuver::files {
namespace {

constexpr std::string_view kBrace = "{";
// Damage to this line turns it into an unknown member, which readers refuse.
constexpr std::string_view kBegin = "{\n \"content_sha256\": \"";
constexpr std::string_view kEnd = "\",";
constexpr size_t kDigits = 64;

}  // namespace

std::string Seal(std::string_view json) {
  std::string sealed(kBegin);
  sealed += Sha256Hex(json);
  sealed += kEnd;
  sealed += json.substr(kBrace.size());
  return sealed;
}

bool IsSealed(std::string_view text) { return text.starts_with(kBegin); }

absl::StatusOr<std::string> Unseal(std::string_view text) {
  if (!IsSealed(text)) return std::string(text);
  const std::string_view digest = text.substr(kBegin.size(), kDigits);
  const std::string_view rest = text.substr(std::min(text.size(), kBegin.size() + kDigits));
  if (rest.starts_with(kEnd)) {
    std::string json(kBrace);
    json += rest.substr(kEnd.size());
    if (Sha256Hex(json) == digest) return json;
  }
  return absl::DataLossError("is truncated or altered: its SHA-256 is not what it says");
}

}  // namespace maneuver::files
