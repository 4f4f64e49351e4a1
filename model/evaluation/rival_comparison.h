// Compares a model with its rivals on the same examples, and tests whether differences exceed
// chance.

#ifndef MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
#define MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_

#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "maneuver/v1/rivals.pb.h"
#include "model/data/recording_groups.h"
#include "model/evaluation/evaluator.h"
#include "model/evaluation/grouped_sums.h"

namespace maneuver::evaluation {

// Compares the model with each of kRivals by each of kComparedMetrics, if both have a column. The
// difference is that of two means over the same examples.
//   column: returns the column of a metric in the sums, or nothing.
std::vector<v1::RivalComparison> CompareWithRivals(
    const Estimator& estimator, const std::function<std::optional<int>(std::string_view)>& column);

// Returns the model's standing over all examples, by speed, and by kinematic class. Leaves out
// parts without examples. The bootstrap draws groups from all recordings of the evaluation, as in
// cross-validation.
//   measured: at least one example.
//   groups: those of the evaluation's recordings, in the same order.
v1::RivalStandings MakeRivalStandings(const MeasuredExamples& measured,
                                      const data::RecordingGroups& groups,
                                      const BootstrapOptions& options = {});

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_RIVAL_COMPARISON_H_
