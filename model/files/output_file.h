// A file that is written from front to back.

#ifndef MANEUVER_MODEL_FILES_OUTPUT_FILE_H_
#define MANEUVER_MODEL_FILES_OUTPUT_FILE_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::files {

// Buffers small writes. Not thread-safe. Errors: those of ErrnoStatus (errno_status.h). After an
// error every further call returns that error.
class OutputFile {
 public:
  // Creates the file. ALREADY_EXISTS if it exists.
  static absl::StatusOr<std::unique_ptr<OutputFile>> Create(const std::filesystem::path& file);
  // Opens a file to append after its first `offset` bytes and truncates it there. DATA_LOSS if it
  // has fewer.
  static absl::StatusOr<std::unique_ptr<OutputFile>> Continue(const std::filesystem::path& file,
                                                              int64_t offset);
  // Without a Close, the end of the file may be missing.
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  absl::Status Append(std::string_view bytes);
  // Flushes, syncs and closes. Call once, after the last Append.
  absl::Status Close();

  // Returns the size of the file so far, including what it had before Continue.
  int64_t size_bytes() const { return size_bytes_; }

 private:
  OutputFile(int descriptor, std::filesystem::path file);
  absl::Status WriteThrough(std::string_view bytes);

  int descriptor_;
  const std::filesystem::path file_;
  std::string buffer_;
  int64_t size_bytes_ = 0;
  absl::Status status_;
};

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_OUTPUT_FILE_H_
