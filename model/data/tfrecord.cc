#include "model/data/tfrecord.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "model/data/byte_source.h"
#include "model/files/digest.h"
#include "model/files/errno_status.h"
#include "model/files/output_file.h"
#include "model/kernels/crc32c.h"

namespace maneuver::data {
namespace {

constexpr size_t kLengthBytes = 8;
constexpr size_t kCrcBytes = 4;
constexpr size_t kHeaderBytes = kLengthBytes + kCrcBytes;
// Payloads are read in pieces of this size, so that a record whose length exceeds the file costs no
// memory.
constexpr size_t kPieceBytes = 4 << 20;

template <typename Integer>
Integer LittleEndian(const char* bytes) {
  Integer value = 0;
  for (size_t i = sizeof(Integer); i-- > 0;) {
    value = static_cast<Integer>(value << 8) | static_cast<unsigned char>(bytes[i]);
  }
  return value;
}

template <typename Integer>
void AppendLittleEndian(Integer value, std::string* bytes) {
  for (size_t i = 0; i < sizeof(Integer); ++i) {
    bytes->push_back(static_cast<char>((value >> (8 * i)) & 0xFF));
  }
}

bool LengthIsSound(const char* header) {
  return LittleEndian<uint32_t>(header + kLengthBytes) == MaskedCrc32c({header, kLengthBytes});
}

class Reader final : public TfRecordReader {
 public:
  Reader(std::unique_ptr<ByteSource> source, std::string name, uint64_t max_record_bytes)
      : source_(std::move(source)), name_(std::move(name)), max_record_bytes_(max_record_bytes) {}

  absl::Status Next(std::string* payload) override {
    if (!lost_.ok()) return lost_;
    offset_ = next_offset_;
    payload->clear();
    std::array<char, kHeaderBytes> header;
    const auto header_bytes = source_->Read(header.data(), header.size());
    if (!header_bytes.ok()) return Lose(header_bytes.status().message());
    if (*header_bytes == 0) return absl::OutOfRangeError("end of file");
    if (*header_bytes < header.size()) return Lose("the file ends within the record's length");
    if (!LengthIsSound(header.data())) return Lose("the record's length is damaged (CRC-32C)");
    const auto length = LittleEndian<uint64_t>(header.data());
    if (length > max_record_bytes_) {
      return Lose(absl::StrCat("the record claims ", length, " bytes, more than the ",
                               max_record_bytes_, " that are accepted"));
    }
    if (absl::Status status = ReadPayload(length, payload); !status.ok()) return status;
    std::array<char, kCrcBytes> footer;
    const auto footer_bytes = source_->Read(footer.data(), footer.size());
    if (!footer_bytes.ok()) return Lose(footer_bytes.status().message());
    if (*footer_bytes < footer.size()) return Lose("the file ends within the record's checksum");
    next_offset_ += kHeaderBytes + length + kCrcBytes;
    if (LittleEndian<uint32_t>(footer.data()) != MaskedCrc32c(*payload)) {
      payload->clear();
      return Damaged("the record's payload is damaged (CRC-32C)");
    }
    return absl::OkStatus();
  }

  bool can_continue() const override { return lost_.ok(); }
  uint64_t offset() const override { return offset_; }

 private:
  absl::Status ReadPayload(uint64_t length, std::string* payload) {
    while (payload->size() < length) {
      const size_t had = payload->size();
      const size_t piece = static_cast<size_t>(std::min<uint64_t>(kPieceBytes, length - had));
      payload->resize(had + piece);
      const auto count = source_->Read(payload->data() + had, piece);
      if (!count.ok()) return Lose(count.status().message());
      if (*count < piece) return Lose("the file ends within the record's payload");
    }
    return absl::OkStatus();
  }

  absl::Status Damaged(absl::string_view what) const {
    return absl::DataLossError(absl::StrCat(name_, ", record at byte ", offset_, ": ", what));
  }

  absl::Status Lose(absl::string_view what) {
    lost_ = Damaged(what);
    return lost_;
  }

  const std::unique_ptr<ByteSource> source_;
  const std::string name_;
  const uint64_t max_record_bytes_;
  uint64_t offset_ = 0;
  uint64_t next_offset_ = 0;
  absl::Status lost_;  // not OK: why the framing is lost
};

class FileWriter final : public TfRecordWriter {
 public:
  explicit FileWriter(std::unique_ptr<files::OutputFile> output) : output_(std::move(output)) {}

  absl::Status Append(std::string_view payload) override {
    std::string header;
    AppendLittleEndian<uint64_t>(payload.size(), &header);
    AppendLittleEndian<uint32_t>(MaskedCrc32c(header), &header);
    std::string footer;
    AppendLittleEndian<uint32_t>(MaskedCrc32c(payload), &footer);
    for (const std::string_view part :
         {std::string_view(header), payload, std::string_view(footer)}) {
      digest_.Update(part);
      if (absl::Status status = output_->Append(part); !status.ok()) return status;
    }
    ++records_;
    return absl::OkStatus();
  }

  absl::Status Close() override {
    sha256_ = digest_.Finish();
    return output_->Close();
  }

  int64_t records() const override { return records_; }
  int64_t size_bytes() const override { return output_->size_bytes(); }
  const std::string& sha256() const override { return sha256_; }

 private:
  const std::unique_ptr<files::OutputFile> output_;
  files::Sha256 digest_;
  int64_t records_ = 0;
  std::string sha256_;
};

// Returns whether the file starts like gzip and not like a record. A record whose length happens to
// contain gzip's magic number is still a record.
absl::StatusOr<bool> LooksLikeGzip(const std::filesystem::path& file) {
  auto source = OpenPlain(file);
  if (!source.ok()) return source.status();
  std::array<char, kHeaderBytes> header{};
  const auto count = (*source)->Read(header.data(), header.size());
  if (!count.ok()) return count.status();
  const bool magic = *count >= 3 && std::memcmp(header.data(), "\x1f\x8b\x08", 3) == 0;
  return magic && !(*count == header.size() && LengthIsSound(header.data()));
}

}  // namespace

uint32_t MaskedCrc32c(std::string_view bytes) {
  return std::rotr(kernels::Crc32c(bytes), 15) + 0xA282EAD8u;
}

absl::StatusOr<std::unique_ptr<TfRecordReader>> TfRecordReader::Open(
    const std::filesystem::path& file, const TfRecordReaderOptions& options) {
  bool gzip = false;
  if (options.allow_gzip) {
    const auto looks_like_gzip = LooksLikeGzip(file);
    if (!looks_like_gzip.ok()) return looks_like_gzip.status();
    gzip = *looks_like_gzip;
  }
  auto source = gzip ? OpenGzip(file) : OpenPlain(file);
  if (!source.ok()) return source.status();
  return std::make_unique<Reader>(*std::move(source), files::NameOf(file),
                                  options.max_record_bytes);
}

absl::StatusOr<std::string> ReadRecordAt(const std::filesystem::path& file, uint64_t offset,
                                         uint64_t payload_bytes) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) return files::ErrnoStatus(errno, "open", file);
  const auto file_bytes = static_cast<uint64_t>(in.tellg());
  const auto damaged = [&](absl::string_view what) {
    return absl::DataLossError(
        absl::StrCat(files::NameOf(file), ", record at byte ", offset, ": ", what));
  };
  std::array<char, kHeaderBytes> header;
  in.seekg(static_cast<std::streamoff>(offset));
  in.read(header.data(), header.size());
  if (!in) return damaged("the file ends before it");
  if (!LengthIsSound(header.data())) return damaged("the record's length is damaged (CRC-32C)");
  if (LittleEndian<uint64_t>(header.data()) != payload_bytes) {
    return damaged(absl::StrCat("the record has ", LittleEndian<uint64_t>(header.data()),
                                " bytes, and its index says ", payload_bytes));
  }
  // Before memory is allocated. The header was read, so the file reaches beyond `offset`.
  if (payload_bytes > file_bytes - offset) return damaged("the file ends within the record");
  std::string payload(payload_bytes, '\0');
  std::array<char, kCrcBytes> footer;
  in.read(payload.data(), static_cast<std::streamsize>(payload.size()));
  in.read(footer.data(), footer.size());
  if (!in) return damaged("the file ends within the record");
  if (LittleEndian<uint32_t>(footer.data()) != MaskedCrc32c(payload)) {
    return damaged("the record's payload is damaged (CRC-32C)");
  }
  return payload;
}

absl::StatusOr<std::unique_ptr<TfRecordWriter>> TfRecordWriter::Create(
    const std::filesystem::path& file) {
  auto output = files::OutputFile::Create(file);
  if (!output.ok()) return output.status();
  return std::make_unique<FileWriter>(*std::move(output));
}

}  // namespace maneuver::data
