// A file's bytes front to back, unpacked if it is packed.

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
  // Up to `size` bytes into `bytes`; fewer at the end alone, then 0. DATA_LOSS if the packed stream
  // is damaged, with what came before already given.
  virtual absl::StatusOr<size_t> Read(char* bytes, size_t size) = 0;
};

absl::StatusOr<std::unique_ptr<ByteSource>> OpenPlain(const std::filesystem::path& file);

// Unpacks gzip, also of several members, through a buffer of fixed size.
absl::StatusOr<std::unique_ptr<ByteSource>> OpenGzip(const std::filesystem::path& file);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_BYTE_SOURCE_H_
