// Writes a gzip file. Private to this folder's .cc files.

#ifndef MANEUVER_MODEL_TAGS_GZIP_FILE_H_
#define MANEUVER_MODEL_TAGS_GZIP_FILE_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::tags {

// Has no time and no name in its head, so the same content always makes the same file. Not
// thread-safe.
class GzipFile {
 public:
  // Creates the file. Errors of all methods: those of files::OutputFile; RESOURCE_EXHAUSTED if
  // there is no memory to compress with.
  static absl::StatusOr<std::unique_ptr<GzipFile>> Create(const std::filesystem::path& file);
  virtual ~GzipFile() = default;

  virtual absl::Status Append(std::string_view bytes) = 0;
  // Completes, syncs and closes the file, and returns its size. Call once, last.
  virtual absl::StatusOr<int64_t> Close() = 0;
};

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_GZIP_FILE_H_
