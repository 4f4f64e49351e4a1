#include "model/artifact/safetensors.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace maneuver::artifact {
namespace {

static_assert(std::endian::native == std::endian::little,
              "values are copied as they lie in memory");

using Json = nlohmann::json;

constexpr size_t kLengthBytes = sizeof(uint64_t);
constexpr size_t kMaxHeaderBytes = size_t{16} << 20;
constexpr char kMetadata[] = "__metadata__";

absl::Status Damaged(absl::string_view reason) {
  return absl::DataLossError(absl::StrCat("not a valid safetensors file: ", reason));
}

// Parses a header. Returns nothing if it is not JSON. Sets *duplicate to a key that an object
// contains twice, which the parser itself does not report.
std::optional<Json> ParseHeader(std::string_view text, std::string* duplicate) {
  std::vector<std::set<std::string>> keys;  // of each object that is open
  const auto callback = [&](int, Json::parse_event_t event, Json& value) {
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    if (event == Json::parse_event_t::key) {
      const auto& key = value.get_ref<const std::string&>();
      if (!keys.back().insert(key).second) *duplicate = key;
    }
    return true;
  };
  Json header = Json::parse(text, callback, /*allow_exceptions=*/false);
  if (header.is_discarded()) return std::nullopt;
  return header;
}

// Reads an array of non-negative integers.
std::optional<std::vector<uint64_t>> ReadCounts(const Json& entry, const char* key) {
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_array()) return std::nullopt;
  std::vector<uint64_t> counts;
  for (const Json& element : *found) {
    if (!element.is_number_unsigned()) return std::nullopt;
    counts.push_back(element.get<uint64_t>());
  }
  return counts;
}

// Returns the product of the shape, or nothing if it exceeds `limit`.
std::optional<uint64_t> CountValues(const std::vector<uint64_t>& shape, uint64_t limit) {
  if (std::find(shape.begin(), shape.end(), 0u) != shape.end()) return 0;
  uint64_t count = 1;
  for (const uint64_t size : shape) {
    if (size > limit / count) return std::nullopt;
    count *= size;
  }
  return count;
}

struct Range {
  uint64_t begin;
  uint64_t end;
  auto operator<=>(const Range&) const = default;
};

}  // namespace

std::string SerializeSafetensors(const TensorMap& tensors) {
  Json header = Json::object();
  uint64_t offset = 0;
  for (const auto& [name, tensor] : tensors) {
    const uint64_t size = tensor.values.size() * sizeof(float);
    header[name] = {
        {"dtype", "F32"}, {"shape", tensor.shape}, {"data_offsets", {offset, offset + size}}};
    offset += size;
  }
  std::string text = header.dump();
  text.append((kLengthBytes - text.size() % kLengthBytes) % kLengthBytes, ' ');  // aligns the data

  const uint64_t length = text.size();
  std::string bytes(kLengthBytes, '\0');
  bytes.reserve(kLengthBytes + length + offset);
  std::memcpy(bytes.data(), &length, kLengthBytes);
  bytes += text;
  for (const auto& [name, tensor] : tensors) {
    bytes.append(reinterpret_cast<const char*>(tensor.values.data()),
                 tensor.values.size() * sizeof(float));
  }
  return bytes;
}

absl::StatusOr<TensorMap> ParseSafetensors(std::string_view bytes) {
  if (bytes.size() < kLengthBytes) return Damaged("shorter than its length field");
  uint64_t length = 0;
  std::memcpy(&length, bytes.data(), kLengthBytes);
  if (length > kMaxHeaderBytes) return Damaged(absl::StrCat("header of ", length, " bytes"));
  if (length > bytes.size() - kLengthBytes) return Damaged("truncated within the header");
  const std::string_view data = bytes.substr(kLengthBytes + length);

  std::string duplicate;
  const std::optional<Json> header = ParseHeader(bytes.substr(kLengthBytes, length), &duplicate);
  if (!header.has_value() || !header->is_object())
    return Damaged("the header is not a JSON object");
  if (!duplicate.empty()) return Damaged(absl::StrCat("\"", duplicate, "\" appears twice"));

  TensorMap tensors;
  std::vector<Range> ranges;
  for (const auto& [name, entry] : header->items()) {
    if (name == kMetadata) continue;
    const auto damaged_entry = [&name = name](absl::string_view reason) {
      return Damaged(absl::StrCat("tensor ", name, ": ", reason));
    };
    if (!entry.is_object()) return damaged_entry("no description");
    const auto dtype = entry.find("dtype");
    if (dtype == entry.end() || *dtype != "F32") return damaged_entry("dtype is not F32");
    const auto shape = ReadCounts(entry, "shape");
    if (!shape.has_value()) return damaged_entry("no shape");
    const auto offsets = ReadCounts(entry, "data_offsets");
    if (!offsets.has_value() || offsets->size() != 2) return damaged_entry("no data_offsets");
    const Range range{(*offsets)[0], (*offsets)[1]};
    if (range.begin > range.end || range.end > data.size()) {
      return damaged_entry(absl::StrCat("data_offsets ", range.begin, " to ", range.end,
                                        " are outside the ", data.size(), " bytes of data"));
    }
    const auto count = CountValues(*shape, data.size());
    if (!count.has_value() || *count * sizeof(float) != range.end - range.begin) {
      return damaged_entry("shape and data_offsets disagree");
    }
    Tensor& tensor = tensors[name];
    tensor.shape.assign(shape->begin(), shape->end());
    tensor.values.resize(*count);
    if (*count > 0) {
      std::memcpy(tensor.values.data(), data.data() + range.begin, range.end - range.begin);
    }
    ranges.push_back(range);
  }

  std::sort(ranges.begin(), ranges.end());
  uint64_t covered = 0;
  for (const Range& range : ranges) {
    if (range.begin != covered) return Damaged("tensors overlap or leave a gap");
    covered = range.end;
  }
  if (covered != data.size()) return Damaged("bytes after the last tensor");
  return tensors;
}

}  // namespace maneuver::artifact
