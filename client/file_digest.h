// Computes the SHA-256 of files that are sent or received. Private to the library.

#ifndef MANEUVER_CLIENT_FILE_DIGEST_H_
#define MANEUVER_CLIENT_FILE_DIGEST_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace maneuver::client {

// Returns the SHA-256 of the whole file in lower-case hexadecimal. NOT_FOUND if it cannot be
// opened, DATA_LOSS if it cannot be read to its end.
absl::StatusOr<std::string> Sha256OfFile(const std::string& file);
// Returns the SHA-256 of bytes in the same form.
std::string Sha256Of(absl::string_view bytes);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_DIGEST_H_
