// The measurements of many examples.

#ifndef MANEUVER_MODEL_EVALUATION_MEASURED_EXAMPLES_H_
#define MANEUVER_MODEL_EVALUATION_MEASURED_EXAMPLES_H_

#include <vector>

#include "model/data/example_index.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Ordered by recording. Evaluate averages them.
struct MeasuredExamples {
  std::vector<data::Example> examples;
  std::vector<Measurement> measured;  // one per example
  bool measured_by_waymo = false;     // whether the horizon reaches a time of Waymo's benchmark
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MEASURED_EXAMPLES_H_
