// Parses resource names strictly: a name that parses is safe as a file name, so no name can lead
// out of the data folder.
//
//   id       [a-z][a-z0-9-]*, at most 63 characters
//   version  1, 2, 3, ...: decimal, no leading zero, at most 9 digits
//   job      [a-z0-9][a-z0-9-]*, at most 63 characters
//
// Errors are INVALID_ARGUMENT with the request's `field` as the violation.

#ifndef MANEUVER_SERVER_SECURITY_RESOURCE_NAME_H_
#define MANEUVER_SERVER_SECURITY_RESOURCE_NAME_H_

#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "absl/status/statusor.h"

namespace maneuver::security {

// models/{model}/versions/{version}
struct ModelVersionName {
  std::string model;
  int version = 0;

  std::string ToString() const;
  friend bool operator==(const ModelVersionName&, const ModelVersionName&) = default;
  friend auto operator<=>(const ModelVersionName&, const ModelVersionName&) = default;
};

// models/{model}/aliases/{alias}; references also write models/{model}@{alias}
struct ModelAliasName {
  std::string model;
  std::string alias;

  std::string ToString() const;
  friend bool operator==(const ModelAliasName&, const ModelAliasName&) = default;
  friend auto operator<=>(const ModelAliasName&, const ModelAliasName&) = default;
};

// models/{model}/versions/{version}/evaluations/{evaluation}; the evaluation's id is its dataset's
// id.
struct EvaluationName {
  ModelVersionName version;
  std::string evaluation;

  std::string ToString() const;
  friend bool operator==(const EvaluationName&, const EvaluationName&) = default;
};

inline constexpr std::string_view kServingAlias = "serving";
inline constexpr std::string_view kCandidateAlias = "candidate";

// What a request may name where a version is expected.
using ModelReference = std::variant<ModelVersionName, ModelAliasName>;

// Returns whether `id` has the form of an id, as above.
bool IsResourceId(std::string_view id);

// Parses models/{model} and returns the id.
absl::StatusOr<std::string> ParseModelName(std::string_view name, std::string_view field);
// Parses models/{model}, which means its alias `serving`, models/{model}@{alias}, or a version's
// name.
absl::StatusOr<ModelReference> ParseModelReference(std::string_view name, std::string_view field);
// Does the same as ParseModelReference. Returns nothing if `name` is empty.
absl::StatusOr<std::optional<ModelReference>> ParseOptionalModelReference(std::string_view name,
                                                                          std::string_view field);
absl::StatusOr<ModelVersionName> ParseModelVersionName(std::string_view name,
                                                       std::string_view field);
absl::StatusOr<ModelAliasName> ParseModelAliasName(std::string_view name, std::string_view field);
absl::StatusOr<EvaluationName> ParseEvaluationName(std::string_view name, std::string_view field);
// Parses datasets/{dataset} and returns the id.
absl::StatusOr<std::string> ParseDatasetName(std::string_view name, std::string_view field);
// Parses tags/{tags} and returns the id.
absl::StatusOr<std::string> ParseTagsName(std::string_view name, std::string_view field);
// Parses jobs/{job} and returns the id.
absl::StatusOr<std::string> ParseJobName(std::string_view name, std::string_view field);

// Returns the id of a name models/{model}, datasets/{dataset}, tags/{tags} or jobs/{job} that is
// known to be one.
std::string IdOf(std::string_view name);

// Returns the version that a folder is named after; 0 if `text` is not a version number.
int ParseVersion(std::string_view text);

}  // namespace maneuver::security

#endif  // MANEUVER_SERVER_SECURITY_RESOURCE_NAME_H_
