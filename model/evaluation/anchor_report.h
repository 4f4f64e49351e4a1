// The metrics of the anchor baselines in a report.

#ifndef MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_

#include <span>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Adds the metrics covernet_* and multipath_* (evaluator.h) that are not means over examples. Every
// measurement must have baselines. The means are in example_metrics.h.
void AddAnchorMetrics(std::span<const Measurement> measured, v1::EvaluationReport& report);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
