// Measurements of examples, gathered into a report.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// A report of at least one measurement; evaluator.h names its metrics. The order of the
// measurements alone decides its last bits.
//   measured_by_waymo: whether the horizon reaches a time at which Waymo measures
v1::EvaluationReport MakeReport(std::span<const Measurement> measured, bool measured_by_waymo);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_H_
