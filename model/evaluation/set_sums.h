// Metrics of a whole set of examples that are not means over them.

#ifndef MANEUVER_MODEL_EVALUATION_SET_SUMS_H_
#define MANEUVER_MODEL_EVALUATION_SET_SUMS_H_

#include <cstdint>
#include <optional>

#include "maneuver/v1/training_service.pb.h"
#include "model/evaluation/action_meaning.h"
#include "model/evaluation/anchor_report.h"
#include "model/evaluation/calibration.h"
#include "model/evaluation/measurement.h"

namespace maneuver::evaluation {

// Sums over examples, from which these metrics are computed (evaluator.h defines them): how many
// actions there are and what they mean, and the same of the anchor baselines. Their memory does not
// grow with the examples.
class SetSums {
 public:
  void Add(const Measurement& measured);
  // Adds the examples of other sums, of the same model.
  void Add(const SetSums& other);

  // The number of examples.
  int64_t examples() const { return examples_; }
  // Needs at least one example.
  const ActionStatistics& actions() const { return *actions_; }
  // Sets the metrics, and in `action_uses` the classes of each action. Needs at least one example,
  // and one element of action_uses for each action.
  void Write(v1::EvaluationReport& report) const;

 private:
  int64_t examples_ = 0;
  std::optional<ActionStatistics> actions_;  // set by the first example
  ActionMeaning meaning_;
  AnchorStatistics anchors_;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_SET_SUMS_H_
