// Characters of text that comes from outside.

#ifndef MANEUVER_SERVER_ERRORS_UTF8_H_
#define MANEUVER_SERVER_ERRORS_UTF8_H_

#include <cstddef>
#include <string_view>

namespace maneuver::errors {

// Returns the bytes of the UTF-8 character that `text` begins with; 0 if it begins with none.
// `text` must not be empty.
size_t Utf8Length(std::string_view text);

// Returns whether a UTF-8 character is below U+0020 or from U+007F to U+009F: terminals take these
// for commands.
bool IsControlCharacter(std::string_view character);

// Returns whether UTF-8 text has a control character.
bool HasControlCharacters(std::string_view text);

}  // namespace maneuver::errors

#endif  // MANEUVER_SERVER_ERRORS_UTF8_H_
