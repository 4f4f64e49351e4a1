// Stores measurements as rows of numbers, to be averaged later.

#ifndef MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
#define MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_

#include <span>

#include "maneuver/v1/cross_validation.pb.h"
#include "model/evaluation/measured_examples.h"

namespace maneuver::evaluation {

// Returns the row of ExampleMetrics (example_metrics.h) of each example, and the metrics of the
// whole set that are not means over examples. Needs at least one example.
//   recordings: the number of each recording of the evaluation in the set's plan.
v1::MeasuredSet ToMeasuredSet(const MeasuredExamples& measured, std::span<const int> recordings);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
