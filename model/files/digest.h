// SHA-256 of bytes and files, in lower-case hexadecimal, 64 characters. Errors: those of
// ErrnoStatus for files that cannot be read.

#ifndef MANEUVER_MODEL_FILES_DIGEST_H_
#define MANEUVER_MODEL_FILES_DIGEST_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::files {

// Computes the digest of input that arrives in pieces.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void Update(std::string_view bytes);
  // Adds the first `bytes` of a file, or all of them if it has fewer.
  absl::Status UpdateWithFile(const std::filesystem::path& file, int64_t bytes);
  // Returns the digest. Call once, last.
  std::string Finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

std::string Sha256Hex(std::string_view bytes);
// Returns whether a text is a digest as Sha256Hex writes it: 64 digits, in lower case.
bool IsSha256Hex(std::string_view text);
absl::StatusOr<std::string> Sha256OfFile(const std::filesystem::path& file);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_DIGEST_H_
