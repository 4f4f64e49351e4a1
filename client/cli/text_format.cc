#include "client/cli/text_format.h"

#include <array>
#include <cmath>
#include <ctime>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::cli {
namespace {

// The characters of Unicode at the start of `text` that end lines, or turn the direction of what
// follows, so that it shows as something else: U+200E, U+200F, U+2028 to U+202E, U+2066 to U+2069.
// Returns their number, or 0.
unsigned MisleadingCharacter(std::string_view text) {
  if (text.size() < 3 || text[0] != '\xe2') return 0;
  const auto second = static_cast<unsigned char>(text[1]);
  const auto third = static_cast<unsigned char>(text[2]);
  if ((second != 0x80 && second != 0x81) || third < 0x80 || third > 0xbf) return 0;
  const unsigned character = 0x2000U + (second - 0x80U) * 0x40U + (third - 0x80U);
  const bool is_misleading = character == 0x200e || character == 0x200f ||
                             (character >= 0x2028 && character <= 0x202e) ||
                             (character >= 0x2066 && character <= 0x2069);
  return is_misleading ? character : 0;
}

std::string Escaped(std::string_view text, bool keep_lines) {
  std::string escaped;
  for (size_t i = 0; i < text.size(); ++i) {
    if (const unsigned character = MisleadingCharacter(text.substr(i)); character != 0) {
      escaped += absl::StrFormat("\\u%04x", character);
      i += 2;
      continue;
    }
    const auto byte = static_cast<unsigned char>(text[i]);
    const auto next = i + 1 < text.size() ? static_cast<unsigned char>(text[i + 1]) : 0U;
    if ((byte < 0x20 && !(keep_lines && byte == '\n')) || byte == 0x7f) {
      escaped += absl::StrFormat("\\x%02x", byte);
    } else if (byte == 0xc2 && next >= 0x80 && next < 0xa0) {  // U+0080 .. U+009F in UTF-8
      escaped += absl::StrFormat("\\u%04x", next);
      ++i;
    } else {
      escaped += text[i];
    }
  }
  return escaped;
}

}  // namespace

std::string Fixed(double value, int digits) {
  return std::isfinite(value) ? absl::StrFormat("%.*f", digits, value) : "-";
}

std::string Bytes(int64_t bytes) {
  if (bytes < 1'000) return absl::StrCat(bytes, " B");
  double value = static_cast<double>(bytes);
  const char* unit = "";
  for (const char* next : {"kB", "MB", "GB", "TB"}) {
    value /= 1'000.0;
    unit = next;
    if (value < 999.95) break;
  }
  return absl::StrFormat("%.1f %s", value, unit);
}

std::string Spell(double seconds) {
  if (!(seconds >= 0.0) || !std::isfinite(seconds)) return "-";
  if (seconds < 9.95) return absl::StrFormat("%.1f s", seconds);
  const auto whole = static_cast<int64_t>(std::llround(seconds));
  if (whole < 60) return absl::StrFormat("%d s", whole);
  if (whole < 3600) return absl::StrFormat("%d min %02d s", whole / 60, whole % 60);
  return absl::StrFormat("%d h %02d min", whole / 3600, whole % 3600 / 60);
}

std::string ExactSeconds(double seconds) { return absl::StrFormat("%g s", seconds); }

std::string Share(double share) { return Fixed(100.0 * share, 1) + " %"; }

std::string HowMany(int64_t count, const std::string& noun) {
  return absl::StrCat(count, " ", noun, count == 1 ? "" : "s");
}

std::string Moment(const google::protobuf::Timestamp& time) {
  if (time.seconds() == 0) return "-";
  const std::time_t seconds = time.seconds();
  std::tm local{};
  localtime_r(&seconds, &local);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%d %H:%M:%S", &local);
  return text.data();
}

double ToSeconds(const google::protobuf::Duration& duration) {
  return static_cast<double>(duration.seconds()) + 1e-9 * duration.nanos();
}

double ToSeconds(const google::protobuf::Timestamp& time) {
  return static_cast<double>(time.seconds()) + 1e-9 * time.nanos();
}

std::string Printable(std::string_view text) { return Escaped(text, /*keep_lines=*/false); }

std::string PrintableLines(std::string_view text) { return Escaped(text, /*keep_lines=*/true); }

}  // namespace maneuver::cli
