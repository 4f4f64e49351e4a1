#include "model/tags/shard_tags.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"
#include "model/kernels/crc32c.h"
#include "model/tags/gzip_file.h"

namespace maneuver::tags {
namespace {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little, "columns are mapped as they are");

// A .tags file: these 8 bytes; the size of the head and its CRC-32C, u32 each; the head; then the
// columns. The head and each column end at a multiple of 8 bytes, filled with 0.
constexpr std::string_view kMagic = "mnvrtags";
constexpr size_t kPreamble = 16;
constexpr uint32_t kMostHeadBytes = uint32_t{1} << 30;  // protobuf parses no more

size_t Aligned(size_t bytes) { return (bytes + 7) / 8 * 8; }

// Quotes a field of the CSV if it needs it (RFC 4180).
void AppendField(std::string_view field, std::string* line) {
  if (field.find_first_of("\",\r\n") == std::string_view::npos) {
    line->append(field);
    return;
  }
  line->push_back('"');
  for (const char character : field) {
    if (character == '"') line->push_back('"');
    line->push_back(character);
  }
  line->push_back('"');
}

std::string HeaderLine() {
  std::string line;
  for (const TagColumn& column : CsvColumns()) {
    absl::StrAppend(&line, line.empty() ? "" : ",", column.name());
  }
  return line + "\n";
}

// Returns whether a file is an unfinished CSV or .tags file of a shard, and not of one whose name
// only begins like this one's.
bool IsLeftover(const std::string& name, const TagFile& file) {
  for (const char* kind : {".csv.gz", ".tags"}) {
    const std::string mark = absl::StrCat(".", file.name(), kind, files::kTemporaryMark);
    if (absl::StartsWith(name, mark) && name.find('.', mark.size()) == std::string::npos) {
      return true;
    }
  }
  return false;
}

void RemoveLeftovers(const fs::path& folder, const TagFile& file) {
  std::error_code error;
  std::vector<fs::path> leftovers;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    if (IsLeftover(entry->path().filename().string(), file)) leftovers.push_back(entry->path());
  }
  for (const fs::path& leftover : leftovers) fs::remove(leftover, error);
}

class FileShardTagsWriter : public ShardTagsWriter {
 public:
  FileShardTagsWriter(fs::path folder, const Schema& schema, TagFile file)
      : folder_(std::move(folder)),
        schema_(schema),
        file_(std::move(file)),
        temporary_(folder_ /
                   absl::StrCat(".", file_.name(), ".csv.gz", files::kTemporaryMark, getpid())) {
    head_.set_schema_sha256(schema_.sha256);
    head_.set_shard_sha256(file_.shard_sha256());
    head_.mutable_action_rows()->Resize(schema_.content.action_names_size(), 0);
    AppendField(file_.dataset(), &line_start_);
    least_.fill(std::numeric_limits<int64_t>::max());
    most_.fill(std::numeric_limits<int64_t>::min());
  }

  ~FileShardTagsWriter() override {
    if (csv_ == nullptr) return;
    csv_.reset();
    unlink(temporary_.c_str());
  }
  FileShardTagsWriter(const FileShardTagsWriter&) = delete;
  FileShardTagsWriter& operator=(const FileShardTagsWriter&) = delete;

  absl::Status Begin() {
    RemoveLeftovers(folder_, file_);
    auto csv = GzipFile::Create(temporary_);
    if (!csv.ok()) return csv.status();
    csv_ = *std::move(csv);
    return csv_->Append(HeaderLine());
  }

  absl::Status Add(std::string_view scene, std::span<const CsvRow> rows) override {
    if (rows.empty()) return absl::OkStatus();
    std::string lines;
    for (const CsvRow& each : rows) {
      TagRow row = each.row;
      row[Column::kScene] = head_.scenes_size();
      AddNumbers(row);
      AppendLine(scene, row, each.responsibilities, &lines);
    }
    head_.add_scenes(std::string(scene));
    return csv_->Append(lines);
  }

  absl::Status Commit() override {
    const absl::StatusOr<int64_t> csv_bytes = csv_->Close();
    if (!csv_bytes.ok()) return csv_bytes.status();
    const fs::path csv_file = CsvFileOf(folder_, file_);
    if (rename(temporary_.c_str(), csv_file.c_str()) != 0) {
      return files::ErrnoStatus(errno, "replace", csv_file);
    }
    csv_.reset();
    // The CSV file must be there before the file that says so.
    if (absl::Status status = files::SyncPath(folder_); !status.ok()) return status;
    head_.set_csv_bytes(*csv_bytes);
    return files::WriteFileAtomically(TagsFileOf(folder_, file_), Image());
  }

 private:
  void AddNumbers(const TagRow& row) {
    for (size_t i = 0; i < kColumns; ++i) {
      const int64_t value = row.values[i];
      least_[i] = std::min(least_[i], value);
      most_[i] = std::max(most_[i], value);
      const auto narrow = static_cast<int32_t>(value);
      if (Columns()[i].bytes == 4) {
        numbers_[i].append(reinterpret_cast<const char*>(&narrow), sizeof narrow);
      } else {
        numbers_[i].append(reinterpret_cast<const char*>(&value), sizeof value);
      }
    }
    head_.set_rows(head_.rows() + 1);
    head_.set_windows(head_.windows() + row[Column::kWindows]);
    const auto action = static_cast<int>(row[Column::kAction]);
    head_.set_action_rows(action, head_.action_rows(action) + 1);
  }

  void AppendLine(std::string_view scene, const TagRow& row, const std::string& responsibilities,
                  std::string* lines) const {
    lines->append(line_start_);
    for (size_t i = 0; i < kColumns; ++i) {
      const auto column = static_cast<Column>(i);
      lines->push_back(',');
      if (column == Column::kScene) {
        AppendField(scene, lines);
      } else if (column == Column::kClass) {
        lines->append(ClassName(row[column]));
      } else {
        lines->append(DecimalText(row[column], Columns()[i].decimals));
      }
      if (column == Column::kAction) {
        lines->push_back(',');
        AppendField(schema_.content.action_names(static_cast<int>(row[column])), lines);
      }
    }
    absl::StrAppend(lines, ",", responsibilities, "\n");
  }

  // Returns the content of the .tags file.
  std::string Image() {
    for (size_t i = 0; i < kColumns; ++i) {
      TagColumnPart* part = head_.add_columns();
      part->set_bytes(Columns()[i].bytes);
      part->set_crc(kernels::Crc32c(numbers_[i]));
      part->set_least(head_.rows() > 0 ? least_[i] : 0);
      part->set_most(head_.rows() > 0 ? most_[i] : 0);
    }
    const std::string head = head_.SerializeAsString();
    const auto head_bytes = static_cast<uint32_t>(head.size());
    const uint32_t crc = kernels::Crc32c(head);
    std::string image(kMagic);
    image.append(reinterpret_cast<const char*>(&head_bytes), sizeof head_bytes);
    image.append(reinterpret_cast<const char*>(&crc), sizeof crc);
    image.append(head);
    image.resize(Aligned(image.size()), '\0');
    for (std::string& numbers : numbers_) {
      image.append(numbers);
      image.resize(Aligned(image.size()), '\0');
      std::string().swap(numbers);
    }
    return image;
  }

  const fs::path folder_;
  const Schema& schema_;
  const TagFile file_;
  const fs::path temporary_;
  std::string line_start_;  // the dataset
  std::unique_ptr<GzipFile> csv_;
  TagHead head_;
  std::array<std::string, kColumns> numbers_;
  std::array<int64_t, kColumns> least_;
  std::array<int64_t, kColumns> most_;
};

// Returns how many columns the files of a folder have; the others are later ones.
size_t ColumnsOf(const Schema& schema) {
  return schema.content.format_version() == 1 ? static_cast<size_t>(Column::kMidX) : kColumns;
}

// Returns `bytes` of zeros that take no memory, or MAP_FAILED.
void* MapZeros(size_t bytes) {
  return mmap(nullptr, bytes, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
}

// Returns what is wrong with a head; empty: nothing.
std::string Objection(const TagHead& head, const Schema& schema) {
  // No file holds more, and sizes computed from it cannot overflow.
  constexpr int64_t kMostRows = int64_t{1} << 40;
  if (head.rows() < 0 || head.rows() > kMostRows) return "the number of rows is out of range";
  const size_t columns = ColumnsOf(schema);
  if (head.columns_size() != static_cast<int>(columns)) return "the number of columns is wrong";
  for (size_t i = 0; i < columns; ++i) {
    if (head.columns(static_cast<int>(i)).bytes() != Columns()[i].bytes) {
      return absl::StrCat("column ", Columns()[i].name, " has integers of the wrong size");
    }
  }
  if (head.action_rows_size() != schema.content.action_names_size()) {
    return "it has another number of actions than the tags' model";
  }
  int64_t others = head.rows();  // rows of the actions that follow
  for (const int64_t rows : head.action_rows()) {
    if (rows < 0 || rows > others) return "an action's number of rows is out of range";
    others -= rows;
  }
  if (others != 0) return "its rows are more than those of all actions";
  return "";
}

}  // namespace

absl::StatusOr<std::unique_ptr<ShardTagsWriter>> ShardTagsWriter::Create(const fs::path& folder,
                                                                         const Schema& schema,
                                                                         const TagFile& file) {
  auto writer = std::make_unique<FileShardTagsWriter>(folder, schema, file);
  if (absl::Status status = writer->Begin(); !status.ok()) return status;
  return writer;
}

absl::StatusOr<std::shared_ptr<const ShardTags>> ShardTags::Open(const fs::path& folder,
                                                                 const Schema& schema,
                                                                 const TagFile& file) {
  const fs::path path = TagsFileOf(folder, file);
  const std::shared_ptr<ShardTags> tags(new ShardTags());
  tags->name_ = files::NameOf(path);
  const auto damaged = [&](const std::string& what) {
    return absl::DataLossError(absl::StrCat(tags->name_, " is damaged: ", what,
                                            "; remove it and run the same tag command again"));
  };
  // Without O_NONBLOCK a named pipe in its place would be waited for.
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0) return files::ErrnoStatus(errno, "open", path);
  struct stat about {};
  const bool is_file = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode);
  if (!is_file || about.st_size < static_cast<off_t>(kPreamble)) {
    close(descriptor);
    return damaged(is_file ? "it is too short" : "it is not a file");
  }
  const auto size = static_cast<size_t>(about.st_size);
  void* const mapped = mmap(nullptr, size, PROT_READ, MAP_SHARED, descriptor, 0);
  const int map_error = errno;
  close(descriptor);
  if (mapped == MAP_FAILED) return files::ErrnoStatus(map_error, "map", path);
  tags->data_ = static_cast<const char*>(mapped);
  tags->size_ = size;

  uint32_t head_bytes = 0;
  uint32_t crc = 0;
  std::memcpy(&head_bytes, tags->data_ + kMagic.size(), sizeof head_bytes);
  std::memcpy(&crc, tags->data_ + kMagic.size() + sizeof head_bytes, sizeof crc);
  if (std::string_view(tags->data_, kMagic.size()) != kMagic)
    return damaged("it has another format");
  if (head_bytes > size - kPreamble) return damaged("it is too short");
  if (head_bytes > kMostHeadBytes) return damaged("its header is too long");
  const std::string_view head(tags->data_ + kPreamble, head_bytes);
  if (kernels::Crc32c(head) != crc ||
      !tags->head_.ParseFromArray(head.data(), static_cast<int>(head.size()))) {
    return damaged("its header is damaged");
  }
  if (const std::string what = Objection(tags->head_, schema); !what.empty()) return damaged(what);
  if (tags->head_.schema_sha256() != schema.sha256 ||
      tags->head_.shard_sha256() != file.shard_sha256()) {
    return absl::FailedPreconditionError(
        absl::StrCat(tags->name_, " belongs to another ", kSchemaFile, " or another shard"));
  }
  size_t offset = Aligned(kPreamble + head_bytes);
  const size_t columns = ColumnsOf(schema);
  for (size_t i = 0; i < columns; ++i) {
    tags->parts_[i] = tags->data_ + offset;
    offset += Aligned(tags->rows() * static_cast<size_t>(Columns()[i].bytes));
  }
  if (offset != size) return damaged("its size is wrong");
  if (columns == kColumns) return tags;
  void* const zeros = MapZeros(tags->ZeroBytes());
  if (zeros == MAP_FAILED) return files::ErrnoStatus(errno, "map zeros beside", path);
  tags->zeros_ = static_cast<const char*>(zeros);
  for (size_t i = columns; i < kColumns; ++i) {
    tags->parts_[i] = tags->zeros_;
    tags->head_.add_columns()->set_bytes(Columns()[i].bytes);  // and its range: 0
  }
  return tags;
}

ShardTags::~ShardTags() {
  // The mapping was made in Open, and nothing writes through it.
  if (data_ != nullptr) munmap(const_cast<char*>(data_), size_);
  if (zeros_ != nullptr) munmap(const_cast<char*>(zeros_), ZeroBytes());
}

std::span<const int32_t> ShardTags::Narrow(Column column) const {
  return {reinterpret_cast<const int32_t*>(BytesOf(column)), rows()};
}

std::span<const int64_t> ShardTags::Wide(Column column) const {
  return {reinterpret_cast<const int64_t*>(BytesOf(column)), rows()};
}

absl::Status ShardTags::Verify(Column column) const {
  if (BytesOf(column) == zeros_) return absl::OkStatus();
  const TagColumnPart& part = head_.columns(static_cast<int>(column));
  const size_t bytes = rows() * static_cast<size_t>(part.bytes());
  bool good = kernels::Crc32c({BytesOf(column), bytes}) == part.crc();
  const int64_t numbers = column == Column::kScene ? head_.scenes_size() : head_.action_rows_size();
  if (good &&
      (column == Column::kScene || column == Column::kAction || column == Column::kLikeliest)) {
    good = std::ranges::all_of(Narrow(column),
                               [&](int32_t value) { return value >= 0 && value < numbers; });
  }
  if (good) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(name_, " is damaged in column ", SpecOf(column).name,
                                          "; remove it and run the same tag command again"));
}

bool IsTagged(const fs::path& folder, const Schema& schema, const TagFile& file) {
  const auto tags = ShardTags::Open(folder, schema, file);
  if (!tags.ok()) return false;
  std::error_code error;
  const auto csv_bytes = fs::file_size(CsvFileOf(folder, file), error);
  return !error && csv_bytes == static_cast<uintmax_t>((*tags)->head().csv_bytes());
}

}  // namespace maneuver::tags
