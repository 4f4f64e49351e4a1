// Shows progress on one line that is redrawn while something runs.

#ifndef MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_
#define MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_

#include <google/protobuf/message.h>

#include <chrono>
#include <iosfwd>
#include <string>

namespace maneuver::cli {

// Returns a bar such as "[######----]", with `width` characters between the brackets.
std::string Bar(double fraction, int width);

enum class ProgressForm {
  kNone,  // nothing
  kLine,  // redrawn in place, for a terminal, which cuts off what does not fit into one row
  kJson,  // {"progress": {"fraction": 0.5, ...}}, one line each time
};

// Shows progress at most ten times a second. With kJson it always shows the last state too.
class ProgressLine {
 public:
  ProgressLine(std::ostream& err, ProgressForm form) : err_(err), form_(form) {}
  ~ProgressLine() { Clear(); }

  void Show(double fraction, const std::string& text);
  // Writes a detailed message for programs. Writes every message, without a limit on their rate.
  // Call it only with kJson.
  void ShowJson(const google::protobuf::Message& progress);
  // Removes the line, before something else is printed.
  void Clear();

 private:
  std::ostream& err_;
  const ProgressForm form_;
  bool drawn_ = false;
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_PROGRESS_LINE_H_
