// SHA-256 of what is sent and received. Private to the library.

#ifndef MANEUVER_CLIENT_FILE_DIGEST_H_
#define MANEUVER_CLIENT_FILE_DIGEST_H_

#include <string>

#include "absl/status/statusor.h"

namespace maneuver::client {

// Lower-case hexadecimal, of the whole file. NOT_FOUND if it cannot be opened, DATA_LOSS if it
// cannot be read to its end.
absl::StatusOr<std::string> Sha256OfFile(const std::string& file);

}  // namespace maneuver::client

#endif  // MANEUVER_CLIENT_FILE_DIGEST_H_
