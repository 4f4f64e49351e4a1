// One line that is drawn over and over while something runs.

#ifndef MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_
#define MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_

#include <chrono>
#include <iosfwd>
#include <string>

namespace maneuver::cli {

// "[######----]", `width` characters inside the brackets.
std::string Bar(double fraction, int width);

// On a terminal, redraws its line in place at most ten times a second; elsewhere it is silent.
class ProgressLine {
 public:
  ProgressLine(std::ostream& err, bool interactive) : err_(err), interactive_(interactive) {}
  ~ProgressLine() { Clear(); }

  void Show(double fraction, const std::string& text);
  // Removes the line, before something else is printed.
  void Clear();

 private:
  std::ostream& err_;
  const bool interactive_;
  bool drawn_ = false;
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_
