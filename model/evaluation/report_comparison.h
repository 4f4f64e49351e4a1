// Compares two reports.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_

#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::evaluation {

// Checks that both reports cover the same examples: the same content of the same dataset, the same
// settings that choose examples, the same target types and waypoints, equally many examples.
// FAILED_PRECONDITION otherwise, with what differs and what to do.
absl::Status CheckComparable(const v1::EvaluationReport& a, const v1::EvaluationReport& b);

// Returns whether two settings choose the same examples. Both must be complete. Ignores settings
// that matter only for training (what is held out, examples per epoch, labels).
bool ChooseTheSameExamples(const v1::ExampleSettings& a, const v1::ExampleSettings& b);

// Compares one metric that both reports have. FAILED_PRECONDITION if one lacks it or the name is
// unknown.
//   tolerance: as in Judge, metric_table.h.
absl::StatusOr<v1::MetricComparison> CompareMetric(const v1::EvaluationReport& baseline,
                                                   const v1::EvaluationReport& candidate,
                                                   const std::string& metric, double tolerance);

// Compares everything that both reports have: strata, and metrics in the order of metric_table.h,
// followed by unknown ones by name. Errors: those of CheckComparable.
absl::StatusOr<v1::EvaluationComparison> CompareReports(const v1::EvaluationReport& baseline,
                                                        const v1::EvaluationReport& candidate);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_COMPARISON_H_
