#include "server/jobs/trainer/progress_display.h"

#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/time_util.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::trainer {
namespace {

constexpr int kBarWidth = 24;
constexpr char kClearLine[] = "\r\033[K";

std::string Minutes(const google::protobuf::Duration& duration) {
  const int64_t seconds =
      (google::protobuf::util::TimeUtil::DurationToMilliseconds(duration) + 500) / 1000;
  return absl::StrFormat("%d:%02d", seconds / 60, seconds % 60);
}

void Append(const google::protobuf::Map<std::string, double>& values, const char* name,
            const char* title, std::string* line) {
  const auto found = values.find(name);
  if (found != values.end())
    absl::StrAppend(line, absl::StrFormat("  %s %.4g", title, found->second));
}

}  // namespace

ProgressDisplay::Style ProgressDisplay::ParseStyle(const std::string& name) {
  if (name == "json") return Style::kJson;
  return name == "bar" ? Style::kBar : Style::kNone;
}

ProgressDisplay::~ProgressDisplay() {
  if (line_open_) out_ << kClearLine << std::flush;
}

void ProgressDisplay::Show(const v1::JobProgress& progress) {
  if (style_ == Style::kBar) ShowBar(progress);
  if (style_ != Style::kJson) return;
  std::string json;
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  if (google::protobuf::util::MessageToJsonString(progress, &json, options).ok()) {
    out_ << json << "\n" << std::flush;
  }
}

std::string DescribeEpoch(const v1::JobProgress& progress) {
  const v1::EpochReport& report = progress.epoch_report();
  std::string line =
      absl::StrFormat("%-9s %3d/%d", progress.phase(), progress.epoch(), progress.epochs());
  Append(report.training(), "loss", "loss", &line);
  Append(report.validation(), "loss", "held out", &line);
  Append(report.validation(), "log_likelihood", "ln p a waypoint", &line);
  if (report.action_usage_size() > 0) {
    absl::StrAppend(&line, "  effective actions ", report.effective_actions(), " of ",
                    report.action_usage_size());
  }
  if (report.mutual_information() > 0.0) {
    absl::StrAppend(&line, absl::StrFormat("  I(y;s) %.2f", report.mutual_information()));
  }
  return line;
}

bool PrintsBold() {
  const char* const no_color = std::getenv("NO_COLOR");
  return isatty(STDOUT_FILENO) == 1 && (no_color == nullptr || *no_color == '\0');
}

void ProgressDisplay::ShowBar(const v1::JobProgress& progress) {
  if (progress.has_epoch_report()) {
    out_ << kClearLine << DescribeEpoch(progress) << "\n";
  }
  const int filled = std::clamp(static_cast<int>(progress.fraction() * kBarWidth), 0, kBarWidth);
  std::string line = absl::StrFormat("%s[%s%s] %3.0f %%  %s", kClearLine, std::string(filled, '#'),
                                     std::string(kBarWidth - filled, '.'),
                                     100.0 * progress.fraction(), progress.phase());
  if (progress.epoch() > 0) {
    absl::StrAppend(&line, " ", progress.epoch(), "/", progress.epochs());
  }
  if (progress.has_time_left()) {
    absl::StrAppend(&line, "  ", Minutes(progress.time_left()), " left");
  }
  out_ << line << std::flush;
  line_open_ = true;
}

}  // namespace maneuver::trainer
