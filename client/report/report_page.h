// Builds the page of a report for a browser.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_
#define MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_

#include <string>

#include "client/report/report_data.h"

namespace maneuver::report {

// Returns one self-contained HTML document with style, program and data. Its
// Content-Security-Policy allows only that style and that program, by their digests, and no
// network. Text in the data is shown as text and never run.
std::string ReportPage(const ReportData& data);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_
