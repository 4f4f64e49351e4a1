// Prints progress for the supervisor (JSON lines) or for people (a bar).

#ifndef MANEUVER_SERVER_JOBS_TRAINER_PROGRESS_DISPLAY_H_
#define MANEUVER_SERVER_JOBS_TRAINER_PROGRESS_DISPLAY_H_

#include <ostream>
#include <string>

#include "maneuver/v1/training_service.pb.h"

namespace maneuver::trainer {

class ProgressDisplay {
 public:
  enum class Style {
    kJson,  // each progress as one line of proto3 JSON
    kBar,   // a line that is redrawn in place, and one that stays for each epoch
    kNone,
  };

  // Parses "json", "bar" or "none".
  static Style ParseStyle(const std::string& name);

  ProgressDisplay(Style style, std::ostream& out) : style_(style), out_(out) {}
  // Ends the bar's line.
  ~ProgressDisplay();

  void Show(const v1::JobProgress& progress);

 private:
  void ShowBar(const v1::JobProgress& progress);

  Style style_;
  std::ostream& out_;
  bool line_open_ = false;
};

// Returns whether standard output is a terminal that may show bold text: NO_COLOR is not set.
bool PrintsBold();

// Returns the result of an epoch in one line: "joint 3/10  loss 41.2  held out 43.9  ...".
std::string DescribeEpoch(const v1::JobProgress& progress);

}  // namespace maneuver::trainer

#endif  // MANEUVER_SERVER_JOBS_TRAINER_PROGRESS_DISPLAY_H_
