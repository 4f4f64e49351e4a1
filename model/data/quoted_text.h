// Text of a file that is read, as messages quote it.

#ifndef MANEUVER_MODEL_DATA_QUOTED_TEXT_H_
#define MANEUVER_MODEL_DATA_QUOTED_TEXT_H_

#include <string>
#include <string_view>

namespace maneuver::data {

// Returns "'abc'", with '?' for characters that do not belong in a message. At most 60 characters
// are quoted.
std::string QuotedText(std::string_view text);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_QUOTED_TEXT_H_
