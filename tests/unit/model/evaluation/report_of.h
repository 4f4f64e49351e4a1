#ifndef MANEUVER_TESTS_UNIT_MODEL_EVALUATION_REPORT_OF_H_
#define MANEUVER_TESTS_UNIT_MODEL_EVALUATION_REPORT_OF_H_

#include <span>

#include "model/evaluation/report.h"

namespace maneuver::evaluation {

// Returns the report of at least one measurement.
inline v1::EvaluationReport ReportOf(std::span<const Measurement> measured,
                                     bool measured_by_waymo) {
  ReportSums sums(measured_by_waymo);
  for (const Measurement& each : measured) sums.Add(each);
  return sums.MakeReport();
}

}  // namespace maneuver::evaluation

#endif  // MANEUVER_TESTS_UNIT_MODEL_EVALUATION_REPORT_OF_H_
