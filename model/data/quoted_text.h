// Quotes the text of a file in a message.

#ifndef MANEUVER_MODEL_DATA_QUOTED_TEXT_H_
#define MANEUVER_MODEL_DATA_QUOTED_TEXT_H_

#include <string>
#include <string_view>

namespace maneuver::data {

// Returns "'abc'", with '?' for each byte that is not printable ASCII. Text of more than 60 bytes
// is cut: "'abc...'".
std::string QuotedText(std::string_view text);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_QUOTED_TEXT_H_
