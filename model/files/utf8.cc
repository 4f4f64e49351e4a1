#include "model/files/utf8.h"

#include <algorithm>
#include <iterator>

namespace maneuver::files {
namespace {

constexpr size_t kMostBytesOfCharacter = 4;

bool IsContinuation(char c) { return (static_cast<unsigned char>(c) & 0xc0) == 0x80; }

bool ChangesDirection(std::string_view character) {
  constexpr std::string_view kMarks[] = {"\u061c", "\u200e", "\u200f", "\u202a",
                                         "\u202b", "\u202c", "\u202d", "\u202e",
                                         "\u2066", "\u2067", "\u2068", "\u2069"};
  return std::ranges::find(kMarks, character) != std::end(kMarks);
}

}  // namespace

size_t Utf8Length(std::string_view text) {
  const auto lead = static_cast<unsigned char>(text.front());
  if (lead < 0x80) return 1;
  const size_t length = lead >= 0xc2 && lead < 0xe0   ? 2
                        : lead >= 0xe0 && lead < 0xf0 ? 3
                        : lead >= 0xf0 && lead < 0xf5 ? 4
                                                      : 0;
  if (length == 0 || text.size() < length) return 0;
  for (size_t i = 1; i < length; ++i) {
    if (!IsContinuation(text[i])) return 0;
  }
  const auto second = static_cast<unsigned char>(text[1]);
  const bool overlong = (lead == 0xe0 && second < 0xa0) || (lead == 0xf0 && second < 0x90);
  const bool outside = (lead == 0xed && second >= 0xa0) || (lead == 0xf4 && second >= 0x90);
  return overlong || outside ? 0 : length;
}

bool IsUtf8(std::string_view text) {
  while (!text.empty()) {
    const size_t length = Utf8Length(text);
    if (length == 0) return false;
    text.remove_prefix(length);
  }
  return true;
}

bool IsControlCharacter(std::string_view character) {
  const auto lead = static_cast<unsigned char>(character.front());
  if (character.size() == 1) return lead < 0x20 || lead == 0x7f;
  return character.size() == 2 && lead == 0xc2 && static_cast<unsigned char>(character[1]) < 0xa0;
}

bool HasUnprintableCharacters(std::string_view text) {
  while (!text.empty()) {
    const size_t length = std::max<size_t>(Utf8Length(text), 1);
    const std::string_view character = text.substr(0, length);
    if (IsControlCharacter(character) || ChangesDirection(character)) return true;
    text.remove_prefix(length);
  }
  return false;
}

bool IsLongerThan(std::string_view text, size_t most) {
  if (text.size() > most * kMostBytesOfCharacter) return true;
  return text.size() - static_cast<size_t>(std::ranges::count_if(text, IsContinuation)) > most;
}

}  // namespace maneuver::files
