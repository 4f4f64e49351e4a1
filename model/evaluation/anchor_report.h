// The rows of the anchor baselines in a report.

#ifndef MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Adds those metrics covernet_* and multipath_* (evaluator.h) that are no means over examples, of
// measurements that have baselines. example_metrics.h has the others.
void AddAnchorMetrics(std::span<const Measurement> measured, v1::EvaluationReport& report);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
