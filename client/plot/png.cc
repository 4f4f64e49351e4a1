#include "client/plot/png.h"

#include <zlib.h>

#include <cassert>
#include <cstdint>
#include <string_view>

namespace maneuver::plot {
namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);
constexpr char kUpFilter = 2;  // each byte less the one above it
constexpr int kChannels = 3;

void AppendBigEndian(uint32_t value, std::string* bytes) {
  for (int shift = 24; shift >= 0; shift -= 8) bytes->push_back(static_cast<char>(value >> shift));
}

uint32_t Checksum(const std::string& bytes) {
  return static_cast<uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

// Appends the length, then type and content, then the checksum of these two.
void AppendChunk(std::string_view type, const std::string& content, std::string* png) {
  AppendBigEndian(static_cast<uint32_t>(content.size()), png);
  const std::string checked = std::string(type) + content;
  *png += checked;
  AppendBigEndian(Checksum(checked), png);
}

std::string Header(const cv::Mat& picture) {
  std::string header;
  AppendBigEndian(static_cast<uint32_t>(picture.cols), &header);
  AppendBigEndian(static_cast<uint32_t>(picture.rows), &header);
  header += '\x08';                // bits
  header += '\x02';                // red, green, blue
  header += std::string(3, '\0');  // deflate, filters by row, not interlaced
  return header;
}

// Returns red, green, blue, each row preceded by its filter.
std::string FilteredRows(const cv::Mat& picture) {
  std::string rows;
  rows.reserve(static_cast<size_t>(picture.rows) * (1 + kChannels * picture.cols));
  cv::Mat above = cv::Mat::zeros(1, picture.cols, CV_8UC3);
  for (int y = 0; y < picture.rows; ++y) {
    rows.push_back(kUpFilter);
    for (int x = 0; x < picture.cols; ++x) {
      const auto& here = picture.at<cv::Vec3b>(y, x);
      const auto& up = above.at<cv::Vec3b>(0, x);
      for (const int bgr : {2, 1, 0}) rows.push_back(static_cast<char>(here[bgr] - up[bgr]));
    }
    above = picture.row(y);
  }
  return rows;
}

std::string Deflate(const std::string& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string compressed(size, '\0');
  const int result =
      compress(reinterpret_cast<Bytef*>(compressed.data()), &size,
               reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uLong>(bytes.size()));
  assert(result == Z_OK);  // there is room for all of it
  compressed.resize(size);
  return compressed;
}

}  // namespace

std::string EncodePng(const cv::Mat& picture) {
  assert(picture.type() == CV_8UC3);
  std::string png(kSignature);
  AppendChunk("IHDR", Header(picture), &png);
  AppendChunk("IDAT", Deflate(FilteredRows(picture)), &png);
  AppendChunk("IEND", "", &png);
  return png;
}

}  // namespace maneuver::plot
