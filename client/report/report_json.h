// Converts the data of a report to the JSON that the page reads.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_JSON_H_
#define MANEUVER_CLIENT_REPORT_REPORT_JSON_H_

#include <string>

#include "client/report/report_data.h"

namespace maneuver::report {

// Returns one JSON object that is safe within a <script> element: it contains neither < > & nor the
// line separators that end a line in JavaScript. Invalid UTF-8 is replaced by U+FFFD. If the object
// would be longer than `most_bytes`, the last scenes are left out; "scenesLeftOut" counts them.
std::string ReportJson(const ReportData& data, size_t most_bytes = size_t{12} << 20);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_JSON_H_
