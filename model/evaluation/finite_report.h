#ifndef MANEUVER_MODEL_EVALUATION_FINITE_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_FINITE_REPORT_H_

#include "absl/status/status.h"
#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::evaluation {

// Checks that every number of a report is finite. OUT_OF_RANGE with the path of the first that is
// not: metrics["min_ade_6"], strata[2].metrics["fde_1"].
absl::Status CheckFinite(const v1::EvaluationReport& report);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_FINITE_REPORT_H_
