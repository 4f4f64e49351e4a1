// Characters of text that comes from outside.

#ifndef MANEUVER_MODEL_FILES_UTF8_H_
#define MANEUVER_MODEL_FILES_UTF8_H_

#include <cstddef>
#include <string_view>

namespace maneuver::files {

// Returns the bytes of the UTF-8 character that `text` begins with; 0 if it begins with none.
// `text` must not be empty.
size_t Utf8Length(std::string_view text);

// Returns whether all of `text` is UTF-8. protobuf writes strings that are not, and then refuses to
// read them.
bool IsUtf8(std::string_view text);

// Returns whether a UTF-8 character is below U+0020 or from U+007F to U+009F: terminals take these
// for commands.
bool IsControlCharacter(std::string_view character);

// Returns whether UTF-8 text has a control character, or one that changes the direction of the text
// around it and so makes it look like another (U+061C, U+200E, U+200F, U+202A to U+202E, U+2066 to
// U+2069).
bool HasUnprintableCharacters(std::string_view text);

// Returns whether UTF-8 text has more than `most` characters. Text that is not UTF-8 and has more
// bytes than so many characters can have is longer, too.
bool IsLongerThan(std::string_view text, size_t most);

}  // namespace maneuver::files

#endif  // MANEUVER_MODEL_FILES_UTF8_H_
