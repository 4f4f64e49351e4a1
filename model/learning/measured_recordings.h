// Chooses the held-out recordings that a new model is measured on.

#ifndef MANEUVER_MODEL_LEARNING_MEASURED_RECORDINGS_H_
#define MANEUVER_MODEL_LEARNING_MEASURED_RECORDINGS_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "model/learning/example_set.h"

namespace maneuver::learning {

struct MeasuredRecordings {
  std::vector<size_t> indices;  // into ExampleSet.recordings, ascending
  int64_t examples = 0;         // that they hold
};

// Returns whole recordings that together hold `most` examples, or a few more; all that hold any if
// those are fewer. A hash of their ids decides which, so they are spread over all datasets and all
// times.
MeasuredRecordings ChooseRecordings(const ExampleSet& set, int64_t most);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_MEASURED_RECORDINGS_H_
