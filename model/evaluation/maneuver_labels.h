// Finds what a vehicle was recorded to do during a window of time.

#ifndef MANEUVER_MODEL_EVALUATION_MANEUVER_LABELS_H_
#define MANEUVER_MODEL_EVALUATION_MANEUVER_LABELS_H_

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "maneuver/v1/scenario.pb.h"

namespace maneuver::evaluation {

// Half the default time between two examples, seconds, so that each moment is near an example.
inline constexpr double kNearMoment = 0.25;

// Recorded manoeuvres by scenario and agent. Keeps pointers to the annotations.
class ManeuverLabels {
 public:
  explicit ManeuverLabels(std::span<const v1::ManeuverAnnotation> annotations);

  // Returns the class that covers more of [start, end] than any other; nothing if none was recorded
  // then. Equal names have equal classes. An annotation of a moment (start equals end) says what
  // the agent does from then on: it applies to windows that start within kNearMoment of it. The
  // nearest such annotation takes precedence over all others. Of several for one moment, the last
  // counts, and the others are as if they were not there.
  std::optional<int> Over(const std::string& scenario_id, int64_t agent_id, double start,
                          double end) const;
  // Returns the name of each class.
  const std::vector<std::string>& names() const { return names_; }

 private:
  std::map<std::pair<std::string, int64_t>, std::vector<const v1::ManeuverAnnotation*>> intervals_;
  std::map<std::string, int> classes_;
  std::vector<std::string> names_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MANEUVER_LABELS_H_
