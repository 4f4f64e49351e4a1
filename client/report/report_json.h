// The data of a report, as the page reads it.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_JSON_H_
#define MANEUVER_CLIENT_REPORT_REPORT_JSON_H_

#include <string>

#include "client/report/report_data.h"

namespace maneuver::report {

// Returns one JSON object, which is safe within a <script> element of a page: it has none of the
// characters < > & and no line separators that JavaScript would end a line at. Text that is not
// UTF-8 has U+FFFD in the place of what is wrong. Scenes that would make it longer than
// `most_bytes` are left out, the last ones first; "scenesLeftOut" counts them.
std::string ReportJson(const ReportData& data, size_t most_bytes = size_t{12} << 20);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_JSON_H_
