// TFRecord framing: u64 length, u32 masked CRC-32C of it, payload, u32 masked CRC-32C of that, all
// little-endian.
//
//   03 00 00 00 00 00 00 00   length 3
//   m0 m1 m2 m3               mask(crc32c(the eight bytes above))
//   61 62 63                  "abc"
//   m0 m1 m2 m3               mask(crc32c("abc"))

#ifndef MANEUVER_MODEL_DATA_TFRECORD_H_
#define MANEUVER_MODEL_DATA_TFRECORD_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace maneuver::data {

// Returns the CRC-32C (Castagnoli), rotated and offset as TFRecord requires.
uint32_t MaskedCrc32c(std::string_view bytes);

struct TfRecordReaderOptions {
  // A longer record counts as damage to the framing, even if the CRC of its length matches. 1 GiB.
  uint64_t max_record_bytes = uint64_t{1} << 30;
  // Turn it off for files from other people: a small gzip file can expand enormously.
  bool allow_gzip = true;
};

// Reads one file from front to back. Recognises gzip by its magic number. Uses memory for the
// longest record that really exists.
class TfRecordReader {
 public:
  // Opens the file. Errors: those of OpenPlain (byte_source.h).
  static absl::StatusOr<std::unique_ptr<TfRecordReader>> Open(
      const std::filesystem::path& file, const TfRecordReaderOptions& options = {});
  virtual ~TfRecordReader() = default;

  // Reads the next payload. OUT_OF_RANGE at the end of the file. DATA_LOSS, with file and offset,
  // for a record that is damaged or cannot be read; if can_continue(), the next call reads the
  // record after it.
  virtual absl::Status Next(std::string* payload) = 0;
  // Returns false once the framing is lost: a wrong length, a truncated file, an error of reading.
  virtual bool can_continue() const = 0;
  // Returns the offset of the latest record that Next read, in bytes of the uncompressed stream.
  virtual uint64_t offset() const = 0;
};

// Reads the payload of the record at `offset` of a file that is not packed. DATA_LOSS, naming file
// and offset, if there is no undamaged record of `payload_bytes` there; an error of files if it
// cannot be opened. Safe to call from any thread.
absl::StatusOr<std::string> ReadRecordAt(const std::filesystem::path& file, uint64_t offset,
                                         uint64_t payload_bytes);

// Appends records to a new file. Not thread-safe. Errors: those of files::OutputFile, such as
// ALREADY_EXISTS if there is a file of that name.
class TfRecordWriter {
 public:
  static absl::StatusOr<std::unique_ptr<TfRecordWriter>> Create(const std::filesystem::path& file);
  virtual ~TfRecordWriter() = default;

  virtual absl::Status Append(std::string_view payload) = 0;
  // Flushes and syncs. The file is not complete without it. Call once, last.
  virtual absl::Status Close() = 0;

  // Counts and bytes so far.
  virtual int64_t records() const = 0;
  virtual int64_t size_bytes() const = 0;
  // Returns the file's SHA-256, lower-case hexadecimal. Call after Close.
  virtual const std::string& sha256() const = 0;
};

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_TFRECORD_H_
