// How many examples calibration uses. Trainer and server both estimate memory by it.

#ifndef MANEUVER_MODEL_ARTIFACT_CALIBRATION_EXAMPLES_H_
#define MANEUVER_MODEL_ARTIFACT_CALIBRATION_EXAMPLES_H_

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/model_cost.h"

namespace maneuver::artifact {

// Calibration ignores held-out examples if there are fewer than this.
inline constexpr int64_t kFewestHeldOut = 100;

// The most examples that calibration reads.
struct CalibrationExamples {
  int64_t training = 4096;
  int64_t held_out = 3072;
};

// Returns how many examples calibration uses: so many that their predictions take at most a quarter
// of `data_memory` bytes, but at least kFewestHeldOut of each.
inline CalibrationExamples CalibrationExamplesIn(const v1::ModelSpec& spec, int64_t data_memory) {
  CalibrationExamples most;
  const auto bytes = static_cast<double>((most.training + most.held_out) * PredictionBytes(spec));
  const double share = std::min(1.0, 0.25 * static_cast<double>(data_memory) / bytes);
  for (int64_t* each : {&most.training, &most.held_out}) {
    *each = std::max(kFewestHeldOut,
                     static_cast<int64_t>(std::llround(share * static_cast<double>(*each))));
  }
  return most;
}

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_CALIBRATION_EXAMPLES_H_
