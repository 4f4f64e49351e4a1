// Reads a file, plain or compressed, from front to back.

#ifndef MANEUVER_MODEL_DATA_BYTE_SOURCE_H_
#define MANEUVER_MODEL_DATA_BYTE_SOURCE_H_

#include <cstddef>
#include <filesystem>
#include <memory>

#include "absl/status/statusor.h"

namespace maneuver::data {

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  // Reads up to `size` bytes into `bytes` and returns their number. Returns fewer only at the end
  // and before damage, then 0 or an error. DATA_LOSS if the compressed stream is damaged; earlier
  // calls have returned what precedes the damage. RESOURCE_EXHAUSTED if there is no memory to
  // unpack with; other errors: those of read(2), by ErrnoStatus.
  virtual absl::StatusOr<size_t> Read(char* bytes, size_t size) = 0;
};

// Open a file. Errors: those of open(2), by ErrnoStatus (errno_status.h). OpenGzip unpacks gzip,
// also with several members, through a buffer of fixed size.
absl::StatusOr<std::unique_ptr<ByteSource>> OpenPlain(const std::filesystem::path& file);
absl::StatusOr<std::unique_ptr<ByteSource>> OpenGzip(const std::filesystem::path& file);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_BYTE_SOURCE_H_
