// The rows of the anchor baselines in a report.

#ifndef MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Adds the metrics covernet_* and multipath_* (evaluator.h) of measurements that have them.
void AddAnchorMetrics(std::span<const Measurement> measured, bool measured_by_waymo,
                      v1::EvaluationReport& report);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
