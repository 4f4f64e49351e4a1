// The table of a report's metrics: the unit of each, and which values are better.

#ifndef MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_
#define MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_

#include <optional>
#include <string_view>

#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::evaluation {

// Which values of a metric are better.
enum class Better {
  kNone,    // descriptive: no value is better
  kLower,   // less is better
  kHigher,  // more is better
  kNearer,  // nearer to MetricInfo.ideal
};

struct MetricInfo {
  std::string_view unit;  // "m", "nats", "share" of one; empty: none
  Better better = Better::kNone;
  double ideal = 0.0;  // with kNearer: the value of a Gaussian
  // True for a metric of the model, false for one of a baseline: constant velocity, constant turn
  // rate and acceleration, the faded roll-out, or a baseline trained with the model.
  bool of_model = true;
  // Its position in lists of metrics: accuracy, likelihood, envelope, actions.
  int rank = 0;
};

// Finds a metric by its name in EvaluationReport.metrics (evaluator.h defines them): min_ade_6,
// nll_prior, covernet_miss_rate_5, fde_cv, ... Returns nothing for an unknown name. A baseline's
// metric has Better::kNone, because it says nothing about the model.
std::optional<MetricInfo> FindMetric(std::string_view name);

// Returns whether a metric can decide a comparison: it is the model's own, and some values are
// better.
bool CanDecide(std::string_view name);

// Judges a candidate's value against the baseline's. A value that is not finite is worse than a
// finite one; if neither is finite, the candidate is worse. METRIC_VERDICT_UNSPECIFIED for a metric
// with Better::kNone.
//   tolerance: how much worse a NO_WORSE candidate may be, in the metric's unit; 0 or more.
v1::MetricVerdict Judge(const MetricInfo& metric, double baseline, double candidate,
                        double tolerance);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_
