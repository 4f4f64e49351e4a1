// Flips bytes of files at rest, and looks at what readers make of it.

#ifndef MANEUVER_TESTS_DURABILITY_CORRUPTION_H_
#define MANEUVER_TESTS_DURABILITY_CORRUPTION_H_

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::durability {

// Reads all that a folder holds, as text that differs if anything does.
using ReadAll = std::function<absl::StatusOr<std::string>(const std::filesystem::path& folder)>;

// Bytes [begin, end) of a file.
struct FilePart {
  std::filesystem::path file;
  size_t begin = 0;
  size_t end = 0;
};

// Flips bytes of each regular file of `folder`, one at a time, and calls `read`. Expects an error
// with a message, or the same text as from the whole folder. `also` is accepted too, if given: an
// older state that a reader may fall back to. Afterwards the folder is as it was.
//
// Flips every byte in three ways if the environment has MANEUVER_EVERY_BYTE; otherwise each 61st
// byte of a file of more than 1,000, in one way that changes from byte to byte.
//   parts: if given, no other bytes are flipped, and each of these
void ExpectNoSilentDamage(const std::filesystem::path& folder, const ReadAll& read,
                          const std::vector<std::string>& also = {},
                          const std::vector<FilePart>& parts = {});

}  // namespace maneuver::durability

#endif  // MANEUVER_TESTS_DURABILITY_CORRUPTION_H_
