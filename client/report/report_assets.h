// The files of the report page, compiled in: report.html, report.css, and all scripts joined into
// one. embed.cmake generates the definitions.

#ifndef MANEUVER_CLIENT_REPORT_REPORT_ASSETS_H_
#define MANEUVER_CLIENT_REPORT_REPORT_ASSETS_H_

#include <string_view>

namespace maneuver::report {

std::string_view ReportHtml();
std::string_view ReportCss();
std::string_view ReportJs();

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_REPORT_ASSETS_H_
