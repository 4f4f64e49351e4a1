// Two reports side by side.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_

#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::evaluation {

// OK if both reports are of the same examples: the same contents of the same dataset, the same
// settings that choose examples, the same waypoints, as many examples. Else FAILED_PRECONDITION
// that says what differs, and what to do.
absl::Status CheckComparable(const v1::EvaluationReport& a, const v1::EvaluationReport& b);

// Whether two settings choose the same examples. Both are complete; what decides about training
// alone (what is held out, how many an epoch, labels) is passed over.
bool ChooseTheSameExamples(const v1::ExampleSettings& a, const v1::ExampleSettings& b);

// One metric that both reports have. FAILED_PRECONDITION if one does not, or for a name that no
// metric has.
//   tolerance: as in Judge, metric_table.h
absl::StatusOr<v1::MetricComparison> CompareMetric(const v1::EvaluationReport& baseline,
                                                   const v1::EvaluationReport& candidate,
                                                   const std::string& metric, double tolerance);

// All that both reports have: each metric in the order of metric_table.h, those that it does not
// know last, by name; strata. Errors: those of CheckComparable.
absl::StatusOr<v1::EvaluationComparison> CompareReports(const v1::EvaluationReport& baseline,
                                                        const v1::EvaluationReport& candidate);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_
