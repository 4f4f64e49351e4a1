// How many examples a run has.

#ifndef MANEUVER_MODEL_LEARNING_RUN_EXAMPLES_H_
#define MANEUVER_MODEL_LEARNING_RUN_EXAMPLES_H_

#include <algorithm>
#include <cstdint>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/calibration_examples.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

struct RunExamples {
  int64_t training = 0;   // all of them
  int64_t in_memory = 0;  // the training examples that phases on trajectories and calibration use
  int64_t held_out = 0;   // in memory
  artifact::CalibrationExamples most_calibrated = {};

  // Returns how many examples calibration reads.
  artifact::CalibrationExamples Calibrated() const {
    return {std::min(in_memory, most_calibrated.training),
            std::min(held_out, most_calibrated.held_out)};
  }
};

// Counts the examples of the data. If they do not fit in memory, calibration reads as many as the
// data memory allows.
inline RunExamples CountRunExamples(const v1::ModelSpec& spec, const TrainingData& data) {
  RunExamples examples{data.TrainingExamples(), static_cast<int64_t>(data.training.examples.size()),
                       static_cast<int64_t>(data.validation.examples.size())};
  if (data.windows != nullptr) {
    examples.most_calibrated = artifact::CalibrationExamplesIn(spec, data.data_memory);
  }
  return examples;
}

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RUN_EXAMPLES_H_
