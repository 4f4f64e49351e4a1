// Formats numbers and times for people.

#ifndef MANEUVER_CLIENT_CLI_TEXT_FORMAT_H_
#define MANEUVER_CLIENT_CLI_TEXT_FORMAT_H_

#include <google/protobuf/duration.pb.h>
#include <google/protobuf/timestamp.pb.h>

#include <cstdint>
#include <string>
#include <string_view>

namespace maneuver::cli {

std::string Fixed(double value, int digits);  // "0.250"; "-" if it is not finite
std::string Bytes(int64_t bytes);             // "512 B", "1.5 MB"
std::string Spell(double seconds);            // "0.4 s", "12 s", "3 min 05 s", "2 h 10 min"
std::string ExactSeconds(double seconds);     // "0.25 s": of a setting
std::string Share(double share);              // "12.5 %"
std::string HowMany(int64_t count, const std::string& noun);  // "1 recording", "3 recordings"
std::string Moment(
    const google::protobuf::Timestamp& time);  // local "2026-02-03 14:05:06"; "-" if unset
double ToSeconds(const google::protobuf::Duration& duration);
double ToSeconds(const google::protobuf::Timestamp& time);  // since 1970

// Returns the text with control characters escaped as \x1b or \u009b, so that an id or a label from
// elsewhere cannot control the terminal. Everything else is unchanged.
std::string Printable(std::string_view text);
// Does the same as Printable, but keeps line breaks.
std::string PrintableLines(std::string_view text);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_TEXT_FORMAT_H_
