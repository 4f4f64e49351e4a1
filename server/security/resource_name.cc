#include "server/security/resource_name.h"

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::security {
namespace {

constexpr size_t kMaxIdLength = 63;
constexpr size_t kMaxVersionDigits = 9;

bool IsLower(char c) { return c >= 'a' && c <= 'z'; }
bool IsDigit(char c) { return c >= '0' && c <= '9'; }

bool IsJobId(std::string_view id) {
  return !id.empty() && id.size() <= kMaxIdLength && id.front() != '-' &&
         std::ranges::all_of(id, [](char c) { return IsLower(c) || IsDigit(c) || c == '-'; });
}

// Returns what follows `prefix`; nothing if `text` does not start with it.
std::optional<std::string_view> After(std::string_view text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return std::nullopt;
  return text.substr(prefix.size());
}

// The two parts of "a<separator>b".
struct Halves {
  std::string_view head;
  std::string_view tail;
};
std::optional<Halves> SplitAt(std::string_view text, std::string_view separator) {
  const size_t at = text.find(separator);
  if (at == std::string_view::npos) return std::nullopt;
  return Halves{text.substr(0, at), text.substr(at + separator.size())};
}

absl::Status Malformed(std::string_view field, const std::string& expected) {
  // The message does not repeat the name, which may be anything, of any length.
  return errors::InvalidField(field, absl::StrCat("expected ", expected));
}

constexpr char kIdRule[] = "with ids of lower-case letters, digits and hyphens";

std::optional<ModelVersionName> VersionIn(std::string_view name) {
  const auto rest = After(name, "models/");
  const auto halves = rest ? SplitAt(*rest, "/versions/") : std::nullopt;
  if (!halves || !IsResourceId(halves->head)) return std::nullopt;
  const int version = ParseVersion(halves->tail);
  if (version == 0) return std::nullopt;
  return ModelVersionName{std::string(halves->head), version};
}

std::optional<ModelAliasName> AliasIn(std::string_view name, std::string_view separator) {
  const auto rest = After(name, "models/");
  const auto halves = rest ? SplitAt(*rest, separator) : std::nullopt;
  if (!halves || !IsResourceId(halves->head) || !IsResourceId(halves->tail)) return std::nullopt;
  return ModelAliasName{std::string(halves->head), std::string(halves->tail)};
}

}  // namespace

std::string ModelVersionName::ToString() const {
  return absl::StrCat("models/", model, "/versions/", version);
}

std::string ModelAliasName::ToString() const {
  return absl::StrCat("models/", model, "/aliases/", alias);
}

std::string EvaluationName::ToString() const {
  return absl::StrCat(version.ToString(), "/evaluations/", evaluation);
}

bool IsResourceId(std::string_view id) { return IsJobId(id) && IsLower(id.front()); }

std::string IdOf(std::string_view name) { return std::string(name.substr(name.find('/') + 1)); }

int ParseVersion(std::string_view text) {
  if (text.empty() || text.size() > kMaxVersionDigits || text.front() == '0' ||
      !std::ranges::all_of(text, IsDigit)) {
    return 0;
  }
  int version = 0;
  for (const char c : text) version = 10 * version + (c - '0');
  return version;
}

absl::StatusOr<std::string> ParseModelName(std::string_view name, std::string_view field) {
  const auto id = After(name, "models/");
  if (!id || !IsResourceId(*id)) {
    return Malformed(field, absl::StrCat("models/{model}, ", kIdRule));
  }
  return std::string(*id);
}

absl::StatusOr<ModelReference> ParseModelReference(std::string_view name, std::string_view field) {
  if (auto version = VersionIn(name)) return ModelReference(std::move(*version));
  if (auto alias = AliasIn(name, "@")) return ModelReference(std::move(*alias));
  if (const auto id = After(name, "models/"); id && IsResourceId(*id)) {
    return ModelReference(ModelAliasName{std::string(*id), std::string(kServingAlias)});
  }
  return Malformed(field, absl::StrCat("models/{model}, models/{model}@{alias} or "
                                       "models/{model}/versions/{version}, ",
                                       kIdRule));
}

absl::StatusOr<std::optional<ModelReference>> ParseOptionalModelReference(std::string_view name,
                                                                          std::string_view field) {
  if (name.empty()) return std::nullopt;
  auto reference = ParseModelReference(name, field);
  if (!reference.ok()) return reference.status();
  return *std::move(reference);
}

absl::StatusOr<ModelVersionName> ParseModelVersionName(std::string_view name,
                                                       std::string_view field) {
  if (auto version = VersionIn(name)) return *std::move(version);
  return Malformed(field, absl::StrCat("models/{model}/versions/{version}, ", kIdRule));
}

absl::StatusOr<ModelAliasName> ParseModelAliasName(std::string_view name, std::string_view field) {
  if (auto alias = AliasIn(name, "/aliases/")) return *std::move(alias);
  return Malformed(field, absl::StrCat("models/{model}/aliases/{alias}, ", kIdRule));
}

absl::StatusOr<EvaluationName> ParseEvaluationName(std::string_view name, std::string_view field) {
  if (const auto halves = SplitAt(name, "/evaluations/"); halves && IsResourceId(halves->tail)) {
    if (auto version = VersionIn(halves->head)) {
      return EvaluationName{*std::move(version), std::string(halves->tail)};
    }
  }
  return Malformed(
      field, absl::StrCat("models/{model}/versions/{version}/evaluations/{evaluation}, ", kIdRule));
}

absl::StatusOr<std::string> ParseDatasetName(std::string_view name, std::string_view field) {
  const auto id = After(name, "datasets/");
  if (!id || !IsResourceId(*id)) {
    return Malformed(field, absl::StrCat("datasets/{dataset}, ", kIdRule));
  }
  return std::string(*id);
}

absl::StatusOr<std::string> ParseTagsName(std::string_view name, std::string_view field) {
  const auto id = After(name, "tags/");
  if (!id || !IsResourceId(*id)) return Malformed(field, absl::StrCat("tags/{tags}, ", kIdRule));
  return std::string(*id);
}

absl::StatusOr<std::string> ParseJobName(std::string_view name, std::string_view field) {
  const auto id = After(name, "jobs/");
  if (!id || !IsJobId(*id)) return Malformed(field, absl::StrCat("jobs/{job}, ", kIdRule));
  return std::string(*id);
}

}  // namespace maneuver::security
