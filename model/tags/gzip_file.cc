#include "model/tags/gzip_file.h"

#include <zlib.h>

#include <array>
#include <utility>

#include "model/files/output_file.h"

namespace maneuver::tags {
namespace {

constexpr int kGzipFraming = 16;  // added to the window bits

class ZlibGzipFile : public GzipFile {
 public:
  explicit ZlibGzipFile(std::unique_ptr<files::OutputFile> output) : output_(std::move(output)) {}
  ~ZlibGzipFile() override { deflateEnd(&stream_); }
  ZlibGzipFile(const ZlibGzipFile&) = delete;
  ZlibGzipFile& operator=(const ZlibGzipFile&) = delete;

  bool Begin() {
    return deflateInit2(&stream_, Z_DEFAULT_COMPRESSION, Z_DEFLATED, MAX_WBITS + kGzipFraming,
                        MAX_MEM_LEVEL - 1, Z_DEFAULT_STRATEGY) == Z_OK;
  }

  absl::Status Append(std::string_view bytes) override { return Deflate(bytes, Z_NO_FLUSH); }

  absl::StatusOr<int64_t> Close() override {
    if (absl::Status status = Deflate({}, Z_FINISH); !status.ok()) return status;
    if (absl::Status status = output_->Close(); !status.ok()) return status;
    return output_->size_bytes();
  }

 private:
  absl::Status Deflate(std::string_view bytes, int flush) {
    // zlib does not write through next_in.
    stream_.next_in = const_cast<Bytef*>(reinterpret_cast<const Bytef*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    do {
      stream_.next_out = packed_.data();
      stream_.avail_out = static_cast<uInt>(packed_.size());
      deflate(&stream_, flush);
      const absl::Status status = output_->Append(
          {reinterpret_cast<const char*>(packed_.data()), packed_.size() - stream_.avail_out});
      if (!status.ok()) return status;
    } while (stream_.avail_out == 0);
    return absl::OkStatus();
  }

  std::unique_ptr<files::OutputFile> output_;
  z_stream stream_{};
  std::array<Bytef, 1 << 16> packed_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<GzipFile>> GzipFile::Create(const std::filesystem::path& file) {
  auto output = files::OutputFile::Create(file);
  if (!output.ok()) return output.status();
  auto packed = std::make_unique<ZlibGzipFile>(*std::move(output));
  if (!packed->Begin()) return absl::ResourceExhaustedError("no memory to compress with");
  return packed;
}

}  // namespace maneuver::tags
