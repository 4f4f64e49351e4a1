// JSON files that carry their own digest, so that any changed byte is noticed. That takes a parser
// that refuses unknown members: damage to "content_sha256" itself makes one. The first line of the
// object is
//
//   "content_sha256": "SHA-256 of the file without this line, 64 hexadecimal digits",
//
// The digest is in the file that it protects, so that both are replaced in one step.

#ifndef MANEUVER_MODEL_FILES_SEALED_JSON_H_
#define MANEUVER_MODEL_FILES_SEALED_JSON_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace maneuver::files {

// Returns `json` with its digest. `json` must begin with "{" and a line break, and have at least
// one member.
std::string Seal(std::string_view json);

// Returns whether `text` carries a digest. Files of older releases do not.
bool IsSealed(std::string_view text);

// Returns the JSON that was sealed, or `text` itself if it carries no digest. DATA_LOSS if the
// digest does not match: the text is truncated or altered.
absl::StatusOr<std::string> Unseal(std::string_view text);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_SEALED_JSON_H_
