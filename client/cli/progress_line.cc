#include "client/cli/progress_line.h"

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
  if (!interactive_) return;
  const auto now = std::chrono::steady_clock::now();
  if (drawn_ && now - last_ < std::chrono::milliseconds(100)) return;
  last_ = now;
  drawn_ = true;
  err_ << "\r\x1b[K" << Bar(fraction, 24) << " " << text << std::flush;
}

void ProgressLine::Clear() {
  if (drawn_) err_ << "\r\x1b[K" << std::flush;
  drawn_ = false;
}

}  // namespace maneuver::cli
