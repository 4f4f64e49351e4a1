#include "client/report/report_page.h"

#include <string_view>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "client/report/report_assets.h"
#include "client/report/report_json.h"
#include "model/files/digest.h"

namespace maneuver::report {
namespace {

// As a Content-Security-Policy names an inline script or style.
std::string Digest(std::string_view text) {
  return absl::StrCat("'sha256-",
                      absl::Base64Escape(absl::HexStringToBytes(files::Sha256Hex(text))), "'");
}

std::string EscapedHtml(const std::string& text) {
  return absl::StrReplaceAll(
      text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}, {"'", "&#39;"}});
}

}  // namespace

std::string ReportPage(const ReportData& data) {
  const std::string policy =
      absl::StrCat("default-src 'none'; style-src ", Digest(ReportCss()), "; script-src ",
                   Digest(ReportJs()), "; base-uri 'none'; form-action 'none'");
  // One pass: what the data says is not looked into for more places.
  return absl::StrReplaceAll(std::string(ReportHtml()), {{"{{POLICY}}", policy},
                                                         {"{{TITLE}}", EscapedHtml(data.title)},
                                                         {"{{STYLE}}", std::string(ReportCss())},
                                                         {"{{DATA}}", ReportJson(data)},
                                                         {"{{PROGRAM}}", std::string(ReportJs())}});
}

}  // namespace maneuver::report
