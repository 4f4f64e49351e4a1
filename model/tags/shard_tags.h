// Writes and reads the tags of one shard.

#ifndef MANEUVER_MODEL_TAGS_SHARD_TAGS_H_
#define MANEUVER_MODEL_TAGS_SHARD_TAGS_H_

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/tags/tag_columns.h"
#include "model/tags/tag_folder.h"

namespace maneuver::tags {

// A row, and what only the CSV has of it.
struct CsvRow {
  TagRow row;                    // kScene is set by the writer
  std::string responsibilities;  // q(y|x,s) of 0.01 or more, largest first: "23:0.8123 11:0.1877"
};

// Writes NAME.csv.gz while rows arrive, and NAME.tags at the end. Both appear only once they are
// complete, NAME.tags last: a shard is done if it is there. Keeps the rows' numbers in memory, some
// 110 bytes a row. The same rows always make the same files. Errors: those of GzipFile, and of
// files. Not thread-safe.
class ShardTagsWriter {
 public:
  // Removes what an interrupted writer of this shard has left, and begins.
  //   schema: must outlive the writer
  static absl::StatusOr<std::unique_ptr<ShardTagsWriter>> Create(
      const std::filesystem::path& folder, const Schema& schema, const TagFile& file);
  // Removes what was written, unless Commit succeeded.
  virtual ~ShardTagsWriter() = default;

  // Adds the rows of a recording. Recordings come in the order of their ids.
  virtual absl::Status Add(std::string_view scene, std::span<const CsvRow> rows) = 0;
  // Completes both files. Call once, last.
  virtual absl::Status Commit() = 0;
};

// The .tags file of a shard, mapped into memory. Immutable; safe to use from any thread.
class ShardTags {
 public:
  // Maps the file and checks its header and its size. NOT_FOUND if there is none; DATA_LOSS, naming
  // the file, if it is damaged; FAILED_PRECONDITION if it is of another schema or shard.
  static absl::StatusOr<std::shared_ptr<const ShardTags>> Open(const std::filesystem::path& folder,
                                                               const Schema& schema,
                                                               const TagFile& file);
  ~ShardTags();
  ShardTags(const ShardTags&) = delete;
  ShardTags& operator=(const ShardTags&) = delete;

  const TagHead& head() const { return head_; }
  size_t rows() const { return static_cast<size_t>(head_.rows()); }
  // Checks a column against its checksum, and that numbers of recordings and of actions exist.
  // DATA_LOSS, naming the file and the column. Call it before the values are used. A column that
  // the file's format lacks has the value 0 in each row.
  absl::Status Verify(Column column) const;
  // Returns the integers of a column. Narrow: of 4 bytes; Wide: of 8.
  std::span<const int32_t> Narrow(Column column) const;
  std::span<const int64_t> Wide(Column column) const;
  int64_t Value(Column column, size_t row) const {
    return SpecOf(column).bytes == 4 ? Narrow(column)[row] : Wide(column)[row];
  }

 private:
  ShardTags() = default;
  size_t ZeroBytes() const { return 8 * rows() + 1; }  // of zeros_
  const char* BytesOf(Column column) const { return parts_[static_cast<size_t>(column)]; }

  std::string name_;
  TagHead head_;
  const char* data_ = nullptr;
  size_t size_ = 0;
  const char* zeros_ = nullptr;  // of a column that the format lacks; nullptr: it has all
  std::array<const char*, kColumns> parts_{};
};

// Returns whether the tags of a shard are complete, by both files' heads and sizes.
bool IsTagged(const std::filesystem::path& folder, const Schema& schema, const TagFile& file);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_SHARD_TAGS_H_
