// Measurements as rows of numbers that can be stored and averaged later.

#ifndef MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
#define MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_

#include <span>

#include "maneuver/v1/cross_validation.pb.h"
#include "model/evaluation/evaluator.h"

namespace maneuver::evaluation {

// Returns a row for each example, with the values of ExampleMetrics (example_metrics.h), and the
// metrics of the whole set that are no means over examples. Needs at least one example.
//   recordings: the number that each recording of the evaluation has in the set's plan
v1::MeasuredSet ToMeasuredSet(const MeasuredExamples& measured, std::span<const int> recordings);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
