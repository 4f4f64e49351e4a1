// The metrics of the anchor baselines in a report.

#ifndef MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
#define MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_

#include <optional>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Computes the metrics covernet_* and multipath_* (evaluator.h) that are not means over examples;
// example_metrics.h has the means. Without baselines, the report gets none of them.
class AnchorStatistics {
 public:
  // Adds an example. Either all of them have baselines or none.
  void Add(const Measurement& measured);
  // Adds the examples of other statistics of the same baselines.
  void Add(const AnchorStatistics& other);

  void Write(v1::EvaluationReport& report) const;

 private:
  std::optional<ActionStatistics> covernet_;
  std::optional<ActionStatistics> multipath_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANCHOR_REPORT_H_
