// What each metric of a report is: its unit, and which of two values is the better one.

#ifndef MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_
#define MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_

#include <optional>
#include <string_view>

#include "maneuver/v1/evaluation.pb.h"

namespace maneuver::evaluation {

// Which values of a metric are better.
enum class Better {
  kNone,    // it describes, and does not judge
  kLower,   //
  kHigher,  //
  kNearer,  // to MetricInfo.ideal
};

struct MetricInfo {
  std::string_view unit;  // "m", "nats", "share" of one; empty: none
  Better better = Better::kNone;
  double ideal = 0.0;  // with kNearer: what a Gaussian would have
  // Whether it is the model's own, not that of a baseline beside it: constant velocity, constant
  // turn rate and acceleration, the faded roll-out, or one trained with the model.
  bool of_model = true;
  // Where it stands among the others when they are listed: accuracy, likelihood, envelope, actions.
  int rank = 0;
};

// By its name in EvaluationReport.metrics (evaluator.h defines them): min_ade_6, nll_prior,
// covernet_miss_rate_5, fde_cv, ... Nothing for a name that the table does not know. A baseline's
// metric has no better side: it says nothing of the model.
std::optional<MetricInfo> FindMetric(std::string_view name);

// Whether a metric can decide: it is the model's own and has a better side.
bool CanDecide(std::string_view name);

// How a candidate's value is beside the baseline's. A value that is not finite is the worse one, of
// two such the candidate's.
//   tolerance: by so much it may be worse and is NO_WORSE still; 0 or more, in the metric's unit
v1::MetricVerdict Judge(const MetricInfo& metric, double baseline, double candidate,
                        double tolerance);

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_METRIC_TABLE_H_
