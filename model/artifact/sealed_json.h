// JSON files that carry their own digest, so that no byte of them changes unnoticed. The first line
// of the object is
//
//   "content_sha256": "SHA-256 of the file without this line, 64 hexadecimal digits",
//
// In one file with what it protects: both are replaced in one step.

#ifndef MANEUVER_MODEL_ARTIFACT_SEALED_JSON_H_
#define MANEUVER_MODEL_ARTIFACT_SEALED_JSON_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace maneuver::artifact {

// Returns `json`, an object of at least one member that begins with "{" and a line break, with its
// digest.
std::string Seal(std::string_view json);

// Whether `text` carries a digest. Files of former releases do not.
bool IsSealed(std::string_view text);

// Returns what was sealed, or `text` itself if it carries no digest. DATA_LOSS if the digest is not
// that of the text: it is truncated or altered.
absl::StatusOr<std::string> Unseal(std::string_view text);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_SEALED_JSON_H_
