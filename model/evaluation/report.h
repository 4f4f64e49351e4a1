// Gathers measurements of examples into a report.

#ifndef MANEUVER_MODEL_EVALUATION_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_REPORT_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Makes a report of at least one measurement; evaluator.h defines its metrics. Its last bits depend
// on the order of the measurements and on nothing else.
//   measured_by_waymo: whether the horizon reaches a time at which Waymo's benchmark measures.
v1::EvaluationReport MakeReport(std::span<const Measurement> measured, bool measured_by_waymo);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_REPORT_H_
