#include "client/cli/progress_line.h"

#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cmath>
#include <ostream>

namespace maneuver::cli {

std::string Bar(double fraction, int width) {
  const double share = std::isfinite(fraction) ? std::clamp(fraction, 0.0, 1.0) : 0.0;
  const auto full = static_cast<size_t>(std::floor(share * width + 1e-9));
  return "[" + std::string(full, '#') + std::string(static_cast<size_t>(width) - full, '-') + "]";
}

void ProgressLine::Show(double fraction, const std::string& text) {
  if (form_ == ProgressForm::kNone) return;
  const auto now = std::chrono::steady_clock::now();
  const bool is_last = form_ == ProgressForm::kJson && fraction >= 1.0;
  if (drawn_ && !is_last && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  drawn_ = true;
  if (form_ == ProgressForm::kJson) {
    google::protobuf::Struct progress;
    (*progress.mutable_fields())["fraction"].set_number_value(fraction);
    (*progress.mutable_fields())["text"].set_string_value(text);
    ShowJson(progress);
    return;
  }
  // Without wrapping: "\r" returns to the last row alone, so that each drawing of a line that is
  // longer than the terminal is wide would leave its first rows behind.
  err_ << "\r\x1b[K\x1b[?7l" + Bar(fraction, 24) + " " + text + "\x1b[?7h" << std::flush;
}

void ProgressLine::ShowJson(const google::protobuf::Message& progress) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  std::string text;
  // Fails only for numbers that JSON has not.
  if (!google::protobuf::util::MessageToJsonString(progress, &text, options).ok()) return;
  err_ << "{\"progress\":" << text << "}" << std::endl;
}

void ProgressLine::Clear() {
  if (drawn_ && form_ == ProgressForm::kLine) err_ << "\r\x1b[K" << std::flush;
  drawn_ = false;
}

}  // namespace maneuver::cli
