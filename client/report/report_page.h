// A report as one page for a browser.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_
#define MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_

#include <string>

#include "client/report/report_data.h"

namespace maneuver::report {

// Returns one HTML document that needs nothing else: style, program and data are in it, and its
// Content-Security-Policy allows that style and that program alone, by their digests, and no
// network. What the data says is shown as text and never run.
std::string ReportPage(const ReportData& data);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_PAGE_H_
